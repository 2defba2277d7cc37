// What `voxelpipe info` says about a mesh.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

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

class CliInfo : public ::testing::Test {
 protected:
  CliInfo() : box_(directory_ / "box.glb") { WriteBoxGlb(box_, 1, 2, 4); }

  // Replaces bytes of the box from the end of the file: 72 bytes of indices, before them 96 of positions.
  template <typename T>
  void Replace(size_t before_end, T value) {
    std::vector<uint8_t> bytes = ReadFile(box_);
    std::memcpy(bytes.data() + bytes.size() - before_end, &value, sizeof value);
    std::ofstream(box_, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
  }

  TemporaryDirectory directory_;
  std::string box_;
};

TEST_F(CliInfo, AClosedMeshIsWatertightAndItsNextStepRuns) {
  const CliOutcome outcome = RunCli({"info", box_, "--json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json about = ParseJson(outcome.out);
  EXPECT_EQ(about["size"], json({1.0, 2.0, 4.0}));
  const json& health = about["health"];
  EXPECT_EQ(health["watertight"], true);
  EXPECT_EQ(health["edges"], 18);
  EXPECT_EQ(health["open_edges"], 0);
  EXPECT_EQ(health["shells"], 1);
  EXPECT_EQ(health["fill"], "parity");
  EXPECT_EQ(health["next"], "voxelpipe voxelize " + box_ + " --fill parity -o box.npy");
  EXPECT_EQ(RunCli({"voxelize", box_, "--fill", "parity", "-o", directory_ / "box.npy"}).exit_code, 0);
}

TEST_F(CliInfo, TheTableHasTheSameFacts) {
  const CliOutcome outcome = RunCli({"info", box_});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  for (const char* text : {"size        1 x 2 x 4 metres", "edges       18, 0 open, 0 non-manifold",
                           "duplicates  0 triangles, 0 vertices", "overlaps    none", "watertight  yes",
                           "fill        parity: one closed shell", "next        voxelpipe voxelize "}) {
    EXPECT_THAT(outcome.out, HasSubstr(text));
  }
}

TEST_F(CliInfo, SeveralFilesAndDirectoriesAreDescribedOneByOne) {
  std::filesystem::create_directories(directory_ / "more/deep");
  WriteBoxGlb(directory_ / "more/a.glb", 1, 1, 1);
  WriteBoxGlb(directory_ / "more/deep/b.glb", 1, 1, 1);
  std::ofstream(directory_ / "broken.stl") << "solid\nvertex 1\n";
  const CliOutcome outcome = RunCli({"info", box_, directory_ / "broken.stl", directory_ / "more", "--json"});
  EXPECT_EQ(outcome.exit_code, 1) << "one is broken";
  EXPECT_THAT(outcome.err, HasSubstr("broken.stl: "));
  ASSERT_EQ(LineCount(outcome.out), 2u);
  const size_t end = outcome.out.find('\n');
  EXPECT_EQ(ParseJson(outcome.out.substr(0, end))["input"], box_);
  EXPECT_EQ(ParseJson(outcome.out.substr(end + 1))["input"], std::string(directory_ / "more/a.glb"));
  EXPECT_EQ(LineCount(RunCli({"info", directory_ / "more", "--recursive", "--json"}).out), 2u);
  EXPECT_EQ(RunCli({"info", "-", "-"}).exit_code, 2);
  std::filesystem::create_directories(directory_ / "none");
  EXPECT_EQ(RunCli({"info", directory_ / "none"}).exit_code, 2);
}

TEST_F(CliInfo, AHoleOpensTheMesh) {
  Replace<uint16_t>(2, 3);  // the last corner of the last triangle, which becomes degenerate
  const CliOutcome outcome = RunCli({"info", box_, "--json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json health = ParseJson(outcome.out)["health"];
  EXPECT_EQ(health["watertight"], false);
  EXPECT_EQ(health["open_edges"], 3);
  EXPECT_EQ(health["degenerate_triangles"], 1);
  EXPECT_EQ(health["fill"], "flood");
}

TEST_F(CliInfo, APositionThatIsNotFiniteIsRefusedWithItsPlace) {
  for (const float value : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    Replace(72 + 4, value);
    const CliOutcome outcome = RunCli({"info", box_});
    EXPECT_EQ(outcome.exit_code, 1);
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr("not finite"));
    EXPECT_THAT(outcome.err, HasSubstr("7")) << "the vertex";
  }
}

}  // namespace
}  // namespace voxelpipe
