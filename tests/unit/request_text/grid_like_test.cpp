// The grid of an earlier result, from each file that has it.
#include "request_text/grid_like.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "encode/encode.h"
#include "request_text/request_options.h"
#include "unit/encode/sample_results.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;
using testing::TemporaryDirectory;

class GridLike : public ::testing::Test {
 protected:
  // A result whose place needs every digit of a double.
  VoxelizeResult Result() {
    VoxelizeResult result = testing::EmptyResult({5, 4, 3});
    result.grid.origin = {-1.0 / 3, 1e-20, 12345.678901234567};
    result.grid.voxel_size = {0.1, 1.0 / 7, 2.5};
    testing::AddBits(result, [](int64_t i, int64_t, int64_t) { return i % 2 == 0; });
    return result;
  }
  std::string Write(const std::string& text) {
    std::ofstream(directory_ / "file", std::ios::binary) << text;
    return directory_ / "file";
  }
  std::string Error(const std::string& path) {
    const absl::StatusOr<GridPlace> place = ReadGridPlace(path);
    EXPECT_FALSE(place.ok()) << path;
    return std::string(place.status().message());
  }
  static void ExpectPlace(const std::string& path, const GridSpec& grid) {
    const absl::StatusOr<GridPlace> place = ReadGridPlace(path);
    ASSERT_TRUE(place.ok()) << path << place.status();
    EXPECT_EQ(place->dims, grid.dims) << path;
    EXPECT_EQ(place->origin, grid.origin) << path;
    EXPECT_EQ(place->voxel_size, grid.voxel_size) << path;
  }

  TemporaryDirectory directory_;
};

TEST_F(GridLike, ReadsThePlaceBackFromARawDescriptionAndAnNpzToTheLastBit) {
  const VoxelizeResult result = Result();
  for (const char* name : {"out.raw", "out.npz"}) ASSERT_TRUE(WriteResult(result, directory_ / name).ok());
  ExpectPlace(directory_ / "out.raw.json", result.grid);
  ExpectPlace(directory_ / "out.npz", result.grid);
  RequestOptions options;
  options.grid_like = directory_ / "out.npz";
  const VoxelizeRequest request = BuildRequest(options).value();
  EXPECT_EQ(request.grid.dims, result.grid.dims);
  EXPECT_EQ(request.grid.origin, result.grid.origin);
  EXPECT_EQ(request.grid.voxel_size, result.grid.voxel_size);
}

TEST_F(GridLike, ReadsThePlaceFromASummary) {
  GridSpec grid;
  grid.dims = {8, 4, 2};
  grid.origin = {0, -1, 2};
  grid.voxel_size = {0.5, 0.25, 1};
  ExpectPlace(Write(R"({"input":"a.glb","dims":[8,4,2],"origin":[0,-1,2],"voxel_size":[0.5,0.25,1.0],"hash":""})"
                    "\n"),
              grid);
}

TEST_F(GridLike, AFileWithoutAPlaceIsAnErrorThatNamesFilesWithOne) {
  ASSERT_TRUE(WriteResult(Result(), directory_ / "out.npy").ok());
  EXPECT_THAT(Error(directory_ / "out.npy"),
              HasSubstr("an .npy does not say where its voxels lie; give an OUT.raw.json"));
  EXPECT_THAT(Error(Write("")), HasSubstr("neither JSON nor an .npz"));
  EXPECT_THAT(Error(Write("[1, 2]")), HasSubstr("no object"));
  EXPECT_THAT(Error(Write(R"({"dims": [1, 2, 3], "origin": [0, 0, 0]})")),
              HasSubstr("lacks dims, origin or voxel_size"));
  EXPECT_THAT(Error(Write(R"({"dims": [1, 2.5, 3], "origin": [0, 0, 0], "voxel_size": [1, 1, 1]})")),
              HasSubstr("lacks"));
  EXPECT_THAT(Error(Write(R"({"dims": [1, 0, 3], "origin": [0, 0, 0], "voxel_size": [1, 1, 1]})")), HasSubstr("dims"));
  EXPECT_THAT(Error(Write(R"({"dims": [1, 1, 3], "origin": [0, 0, 0], "voxel_size": [1, -1, 1]})")),
              HasSubstr("voxel size"));
  EXPECT_THAT(Error(Write("{\"dims\": [1, 1, 1]}\n{\"dims\": [1, 1, 1]}\n")), HasSubstr("several summaries"));
  EXPECT_THAT(Error(directory_ / "missing"), HasSubstr("no such file"));
  EXPECT_THAT(Error(directory_.path().string()), HasSubstr("not a regular file"));
}

TEST_F(GridLike, EveryCutOfAnNpzIsAnError) {
  ASSERT_TRUE(WriteResult(Result(), directory_ / "out.npz").ok());
  const std::vector<uint8_t> whole = testing::ReadFile(directory_ / "out.npz");
  for (size_t size = 0; size < whole.size(); size += 7) {
    const std::string path = directory_ / "cut.npz";
    std::ofstream(path, std::ios::binary).write(reinterpret_cast<const char*>(whole.data()), std::streamsize(size));
    EXPECT_FALSE(ReadGridPlace(path).ok()) << size;
  }
}

TEST_F(GridLike, OtherWaysToAGridAreRefusedBesideIt) {
  ASSERT_TRUE(WriteResult(Result(), directory_ / "out.npz").ok());
  const auto error = [&](auto set) {
    RequestOptions options;
    options.grid_like = directory_ / "out.npz";
    set(options);
    const auto request = BuildRequest(options);
    EXPECT_EQ(request.status().code(), absl::StatusCode::kInvalidArgument);
    return std::string(request.status().message());
  };
  EXPECT_THAT(error([](RequestOptions& o) { o.resolution = 8; }), HasSubstr("leave --resolution out"));
  EXPECT_THAT(error([](RequestOptions& o) { o.voxel_size = "1"; }), HasSubstr("leave --voxel-size out"));
  EXPECT_THAT(error([](RequestOptions& o) { o.dims = "1,1,1"; }), HasSubstr("leave --dims out"));
  EXPECT_THAT(error([](RequestOptions& o) { o.origin = "0,0,0"; }), HasSubstr("leave --origin out"));
  EXPECT_THAT(error([](RequestOptions& o) { o.fit = "cube"; }), HasSubstr("leave --fit out"));
  EXPECT_THAT(error([&](RequestOptions& o) { o.grid_like = directory_ / "no.npz"; }),
              HasSubstr("--grid-like: " + directory_ / "no.npz" + ": no such file"));
}

}  // namespace
}  // namespace voxelpipe
