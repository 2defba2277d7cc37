// Where the grid lies: axes, boxes, grids of earlier results.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <fstream>

#include "cli_runner.h"

#include "support/json/json.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::CliOutcome;
using ::testing::HasSubstr;
using testing::LineCount;
using testing::ParseJson;
using testing::ReadFile;
using testing::RunCli;
using testing::TemporaryDirectory;
using testing::WriteBoxGlb;

class CliGrid : public ::testing::Test {
 protected:
  CliGrid() : box_(directory_ / "box.glb") { WriteBoxGlb(box_, 1, 2, 4); }

  json VoxelizeJson(std::vector<std::string> options) {
    options.insert(options.begin(), {"voxelize", box_, "--json"});
    const CliOutcome outcome = RunCli(options);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return ParseJson(outcome.out, false);
  }
  void ExpectRefused(std::vector<std::string> options, const std::string& why) {
    options.insert(options.begin(), {"voxelize", box_});
    const CliOutcome outcome = RunCli(options);
    EXPECT_EQ(outcome.exit_code, 2) << outcome.err;
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(why));
    EXPECT_EQ(outcome.out, "");
  }
  static void ExpectSamePlace(const json& a, const json& b) {
    for (const char* key : {"dims", "origin", "voxel_size"}) EXPECT_EQ(a[key], b[key]) << key;
  }

  TemporaryDirectory directory_;
  std::string box_;
};

TEST_F(CliGrid, GridLikeTakesARawDescriptionASummaryAndAnNpz) {
  const json first =
      VoxelizeJson({"--resolution", "9", "--fit", "cube", "--padding", "2", "-o", directory_ / "out.raw"});
  std::ofstream(directory_ / "summary.json") << first.dump() << "\n";
  VoxelizeJson(
      {"--resolution", "9", "--fit", "cube", "--padding", "2", "--result", "sparse", "-o", directory_ / "out.npz"});
  for (const char* name : {"out.raw.json", "summary.json", "out.npz"}) {
    const json again = VoxelizeJson({"--grid-like", directory_ / name});
    ExpectSamePlace(again, first);
    EXPECT_EQ(again["hash"], first["hash"]) << name;
  }
  ASSERT_EQ(RunCli({"voxelize", box_, "-o", directory_ / "out.npy"}).exit_code, 0);
  ExpectRefused({"--grid-like", directory_ / "out.npy"}, "does not say where its voxels lie; give");
  ExpectRefused({"--grid-like", directory_ / "out.npz", "--resolution", "4"}, "leave --resolution out");
  ExpectRefused({"--grid-like", directory_ / "missing.npz"}, "no such file");
  ExpectRefused({"--grid-like", ""}, "--grid-like");
}

TEST_F(CliGrid, AxesTurnTheMesh) {
  const json summary = VoxelizeJson({"--voxel-size", "0.5", "--axes", "x,z,-y"});
  EXPECT_EQ(summary["dims"], json({2, 8, 4}));
  EXPECT_EQ(summary["origin"], json({0, 0, -2}));
  const json turned = VoxelizeJson({"--voxel-size", "0.5", "--axes", "-y,x,z"});  // begins like an option
  EXPECT_EQ(turned["dims"], json({4, 2, 8}));
  EXPECT_EQ(turned["origin"], json({-2, 0, 0}));
  const json moved = VoxelizeJson({"--voxel-size", "0.5", "--axes", "x,z,-y", "--vertex-shader",
                                   "transform:matrix=1/0/0/10/0/1/0/20/0/0/1/30/0/0/0/1"});
  EXPECT_EQ(moved["origin"], json({10, 30, -22}));
}

// The voxel at the middle of the box's face at the mesh's +z, and its geometric normal.
TEST_F(CliGrid, NormalsFollowTheAxesAndPointInwardsInAMirror) {
  const auto normal = [&](const char* axes, std::array<size_t, 3> dims, std::array<size_t, 3> voxel) {
    const json summary = VoxelizeJson({"--voxel-size", "0.25", "--axes", axes, "--target",
                                       "f32x3:replace:shader=normal", "-o", directory_ / "out.raw"});
    EXPECT_EQ(summary["dims"], json(dims)) << axes;
    const std::vector<uint8_t> bytes = ReadFile(directory_ / "out.raw");
    std::array<float, 3> value{};
    const size_t n = voxel[0] + dims[0] * (voxel[1] + dims[1] * voxel[2]);
    if (bytes.size() >= (n + 1) * sizeof value) std::memcpy(value.data(), &bytes[n * sizeof value], sizeof value);
    return value;
  };
  using Normal = std::array<float, 3>;
  EXPECT_EQ(normal("x,y,z", {4, 8, 16}, {1, 3, 15}), (Normal{0, 0, 1}));
  EXPECT_EQ(normal("x,z,-y", {4, 16, 8}, {1, 15, 4}), (Normal{0, 1, 0}));
  EXPECT_EQ(normal("x,z,y", {4, 16, 8}, {1, 15, 3}), (Normal{0, -1, 0}));  // as documented: flat normals turn inwards
}

TEST_F(CliGrid, AClipIsTheGridOfItsBoxWhateverTheMesh) {
  const json summary = VoxelizeJson({"--clip", "-1,0.5,0,1,1.5,8", "--resolution", "16"});
  EXPECT_EQ(summary["dims"], json({4, 2, 16}));
  EXPECT_EQ(summary["origin"], json({-1, 0.5, 0}));
  EXPECT_EQ(summary["voxel_size"], json({0.5, 0.5, 0.5}));
  const json by_size = VoxelizeJson({"--clip", "-1,0.5,0,1,1.5,8", "--voxel-size", "0.5,0.25,3", "--padding", "1"});
  EXPECT_EQ(by_size["dims"], json({6, 6, 5}));  // 8 / 3 rounded up covers the box
  EXPECT_EQ(by_size["origin"], json({-1.5, 0.25, -3}));
  const json cube = VoxelizeJson({"--clip", "0,0,0,1,2,4", "--resolution", "8", "--fit", "cube"});
  ExpectSamePlace(cube, VoxelizeJson({"--resolution", "8", "--fit", "cube"}));
}

TEST_F(CliGrid, AClipCutsTheVoxelsOfTheWholeMeshOut) {
  const auto raw = [&](std::vector<std::string> options) {
    options.insert(options.end(), {"--fill", "parity", "-o", directory_ / "out.npy"});
    VoxelizeJson(options);
    std::vector<uint8_t> bytes = ReadFile(directory_ / "out.npy");
    bytes.erase(bytes.begin(), bytes.begin() + 128);  // the header
    return bytes;
  };
  const std::vector<uint8_t> whole = raw({"--voxel-size", "0.25"});
  const std::vector<uint8_t> part = raw({"--voxel-size", "0.25", "--clip", "0.5,0.5,1,1,1.5,3"});
  ASSERT_EQ(whole.size(), 4u * 8 * 16);
  ASSERT_EQ(part.size(), 2u * 4 * 8);
  for (size_t k = 0; k < 8; ++k) {
    for (size_t j = 0; j < 4; ++j) {
      for (size_t i = 0; i < 2; ++i) {
        EXPECT_EQ(part[i + 2 * (j + 4 * k)], whole[i + 2 + 4 * (j + 2 + 8 * (k + 4))]) << i << " " << j << " " << k;
      }
    }
  }
}

TEST_F(CliGrid, AClipIsOfTheWorldBehindTheAxes) {
  const json summary =
      VoxelizeJson({"--axes", "x,z,-y", "--clip", "0,0,-2,1,4,0", "--voxel-size", "0.5", "--fill", "parity"});
  EXPECT_EQ(summary["dims"], json({2, 8, 4}));
  EXPECT_EQ(summary["occupied"], 2 * 8 * 4);
}

TEST_F(CliGrid, WrongBoxesExitWith2) {
  ExpectRefused({"--clip", "0,0,0,1,1"}, "six expected");
  ExpectRefused({"--clip", "0,0,0,1,1,x"}, "'x' is not a number");
  ExpectRefused({"--clip", "0,0,0,1,1,inf"}, "not finite");
  ExpectRefused({"--clip", "0,0,0,1,0,1"}, "empty along y");
  ExpectRefused({"--clip", "0,0,2,1,1,1"}, "inverted along z");
  ExpectRefused({"--clip", "0,0,0,1,1,1e9", "--voxel-size", "0.1"}, "--clip: ");
  ExpectRefused({"--clip", "0,0,0,1,1,1", "--dims", "1,1,1", "--origin", "0,0,0", "--voxel-size", "1"}, "--dims");
  ExpectRefused({"--clip", "0,0,0,1,1,1", "--voxel-size", "1", "--fit", "cube"}, "--fit");
  ExpectRefused({"--clip", "0,0,0,1,1,1", "--grid-like", box_}, "leave --clip out");
  ExpectRefused({"--clip", ""}, "--clip");
}

TEST_F(CliGrid, WrongAxesExitWith2) {
  ExpectRefused({"--axes", "x,x,y"}, "as in x,z,-y");
  ExpectRefused({"--axes", ""}, "--axes");
  ExpectRefused({"--axes", "x,z,-y", "--vertex-shader", "skin:time=0"}, "leave the axes out");
}

}  // namespace
}  // namespace voxelpipe
