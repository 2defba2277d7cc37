#include "encode/encode.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "encode/npy.h"
#include "sample_results.h"
#include "support/json/json.h"

namespace voxelpipe {
namespace {

using testing::AddBits;
using testing::AddFloats;
using ::testing::ElementsAre;
using testing::EmptyResult;
using ::testing::HasSubstr;
using testing::ParseJson;
using testing::ReadFile;
using testing::SampleBit;
using testing::SampleValue;
using testing::TemporaryDirectory;

TEST(FileExtension, IsLowerCaseWithItsDot) {
  EXPECT_EQ(FileExtension("a.npy"), ".npy");
  EXPECT_EQ(FileExtension("a.b.NPY"), ".npy");
  EXPECT_EQ(FileExtension("dir.npy/a"), "");
  EXPECT_EQ(FileExtension("dir/.npy"), "");
  EXPECT_EQ(FileExtension("a"), "");
  EXPECT_EQ(FileExtension(""), "");
  EXPECT_EQ(FileExtension("a."), ".");
}

TEST(WriteResult, DescribesRawFiles) {
  const TemporaryDirectory directory;
  VoxelizeResult result = EmptyResult({3, 4, 5}, Layout::kPlanar);
  result.grid.origin = {-1, 0.1, 2};
  result.grid.voxel_size = {0.5, 0.25, 2};
  AddBits(result, SampleBit);
  AddFloats(result, 2, SampleValue);
  ASSERT_TRUE(WriteResult(result, directory / "out.raw").ok());
  EXPECT_EQ(directory.FileCount(), 3u);
  EXPECT_THAT(WrittenPaths("out.raw", 2), ElementsAre("out.0.raw", "out.1.raw", "out.raw.json"));
  EXPECT_THAT(WrittenPaths("out.npy", 2), ElementsAre("out.0.npy", "out.1.npy"));

  using nlohmann::json;
  const json about = ParseJson(ReadFile(directory / "out.raw.json"));
  EXPECT_EQ(about["dims"], json({3, 4, 5}));
  EXPECT_EQ(about["origin"], json({-1.0, 0.1, 2.0}));
  EXPECT_EQ(about["voxel_size"], json({0.5, 0.25, 2.0}));
  EXPECT_EQ(about["index_to_world"],
            json({{0.5, 0.0, 0.0, -0.75}, {0.0, 0.25, 0.0, 0.225}, {0.0, 0.0, 2.0, 3.0}, {0.0, 0.0, 0.0, 1.0}}));
  EXPECT_EQ(about["layout"], "planar");
  EXPECT_EQ(about["hash"], json());
  ASSERT_EQ(about["targets"].size(), 2u);
  const json& bits = about["targets"][0];
  EXPECT_EQ(bits["file"], "out.0.raw");
  EXPECT_EQ(bits["dtype"], "bit");
  EXPECT_EQ(bits["shape"], json({5, 4, 3}));
  const json& floats = about["targets"][1];
  EXPECT_EQ(floats["file"], "out.1.raw");
  EXPECT_EQ(floats["format"], "f32");
  EXPECT_EQ(floats["components"], 2);
  EXPECT_EQ(floats["dtype"], "<f4");
  EXPECT_EQ(floats["shape"], json({2, 5, 4, 3}));
  EXPECT_EQ(floats["bytes"], std::filesystem::file_size(directory / "out.1.raw"));
}

TEST(OutputPaths, NumberSeveralTargetsButNotPictures) {
  EXPECT_THAT(OutputPaths("d.x/a.npy", 1), ElementsAre("d.x/a.npy"));
  EXPECT_THAT(OutputPaths("d.x/a.npy", 3), ElementsAre("d.x/a.0.npy", "d.x/a.1.npy", "d.x/a.2.npy"));
  EXPECT_THAT(OutputPaths("a.RAW", 2), ElementsAre("a.0.RAW", "a.1.RAW"));
  EXPECT_THAT(OutputPaths("a.png", 3), ElementsAre("a.png"));
}

TEST(WriteResult, RawIsTheTargetsBytes) {
  const TemporaryDirectory directory;
  VoxelizeResult result = EmptyResult({5, 3, 3}, Layout::kPlanar);
  AddBits(result, SampleBit);
  AddFloats(result, 3, SampleValue);
  ASSERT_TRUE(WriteResult(result, directory / "out.raw").ok());
  for (size_t i = 0; i < 2; ++i) {
    const auto bytes = result.targets[i].bytes();
    EXPECT_EQ(ReadFile(OutputPaths(directory / "out.raw", 2)[i]), std::vector<uint8_t>(bytes.begin(), bytes.end()));
  }
  EXPECT_EQ(directory.FileCount(), 3u);  // out.raw.json says what they are
}

TEST(WriteResult, NpyOfBitsIsOneByteAVoxel) {
  const TemporaryDirectory directory;
  // 1x1x1 up to sizes around a byte, a word, and past one written piece (4 Mi voxels).
  for (const std::array<int64_t, 3> dims : {std::array<int64_t, 3>{1, 1, 1},
                                            {7, 1, 1},
                                            {8, 1, 1},
                                            {9, 1, 1},
                                            {63, 1, 1},
                                            {5, 13, 1},
                                            {3, 7, 11},
                                            {131, 179, 181}}) {
    VoxelizeResult result = EmptyResult(dims);
    AddBits(result, SampleBit);
    ASSERT_TRUE(WriteResult(result, directory / "out.npy").ok());
    const std::vector<uint8_t> file = ReadFile(directory / "out.npy");
    const size_t header = NpyHeader("|u1", HeaderOf(result).arrays[0].shape).size();
    ASSERT_EQ(file.size(), header + result.grid.voxels());
    size_t wrong = 0, at = header;
    for (int64_t k = 0; k < dims[2]; ++k) {
      for (int64_t j = 0; j < dims[1]; ++j) {
        for (int64_t i = 0; i < dims[0]; ++i) wrong += file[at++] != uint8_t(SampleBit(i, j, k) ? 1 : 0);
      }
    }
    EXPECT_EQ(wrong, 0u) << dims[0] << "x" << dims[1] << "x" << dims[2];
  }
}

TEST(WriteResult, RefusesAnExtensionItDoesNotKnow) {
  const TemporaryDirectory directory;
  VoxelizeResult result = EmptyResult({1, 1, 1});
  AddBits(result, SampleBit);
  for (const char* name : {"out.xyz", "out", "out."}) {
    const absl::Status status = WriteResult(result, directory / name);
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    EXPECT_THAT(std::string(status.message()), HasSubstr(name));
  }
  EXPECT_EQ(directory.FileCount(), 0u);
}

TEST(WriteResult, LeavesNoFileWhenTheJobIsCancelled) {
  const TemporaryDirectory directory;
  VoxelizeResult result = EmptyResult({16, 16, 16});
  AddBits(result, SampleBit);
  JobContext job;
  job.Cancel();
  for (const char* name : {"a.npy", "a.raw", "a.png"}) {
    EXPECT_EQ(WriteResult(result, directory / name, &job).code(), absl::StatusCode::kCancelled) << name;
  }
  EXPECT_EQ(directory.FileCount(), 0u);
}

}  // namespace
}  // namespace voxelpipe
