// Several meshes on one grid, by the real command.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "cli_runner.h"

#include "support/json/json.h"

namespace voxelpipe {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::CliOutcome;
using ::testing::HasSubstr;
using testing::LineCount;
using testing::ParseJson;
using testing::RunCli;
using testing::TemporaryDirectory;
using testing::WriteBoxGlb;

class CliTogether : public ::testing::Test {
 protected:
  CliTogether() {
    WriteBoxGlb(directory_ / "one.glb", 1, 1, 1);
    WriteBoxGlb(directory_ / "two.glb", 2, 1, 1);
  }
  CliOutcome Voxelize(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"voxelize", "--voxel-size", "0.25", "--json"});
    return RunCli(arguments);
  }
  std::string List(const json& meshes) {
    std::ofstream(directory_ / "list.json") << json{{"meshes", meshes}}.dump();
    return directory_ / "list.json";
  }
  // The one line on stderr of a list that is wrong.
  std::string Refused(const json& meshes) {
    const CliOutcome outcome = Voxelize({"--together", List(meshes)});
    EXPECT_EQ(outcome.exit_code, 2) << meshes;
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    return outcome.err;
  }

  static std::string Contents(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }

  const json moved_ = {1, 0, 0, 3, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};  // 3 along x
  TemporaryDirectory directory_;
};

TEST_F(CliTogether, AllInputsAreOnOneGrid) {
  // The option has no value here, wherever it stands.
  std::string hash;
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{directory_ / "one.glb", directory_ / "two.glb", "--together"},
        {"--together", directory_ / "one.glb", directory_ / "two.glb"},
        {directory_ / "one.glb", "--together", directory_ / "two.glb"}}) {
    const CliOutcome outcome = Voxelize(arguments);
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    ASSERT_EQ(LineCount(outcome.out), 1u);
    const json summary = ParseJson(outcome.out);
    EXPECT_EQ(summary["triangles"], 24);
    EXPECT_EQ(summary["dims"], (json{8, 4, 4}));
    EXPECT_EQ(summary["input"], std::string(directory_ / "one.glb") + " + " + std::string(directory_ / "two.glb"));
    EXPECT_TRUE(summary["stages"].contains("place"));
    if (!hash.empty()) {
      EXPECT_EQ(summary["hash"], hash);
    }
    hash = summary["hash"];
  }
}

TEST_F(CliTogether, AListPlacesEachMesh) {
  const std::string list =
      List({{{"input", "one.glb"}, {"label", 4}}, {{"input", "one.glb"}, {"matrix", moved_}, {"name", "other"}}});
  const CliOutcome outcome = Voxelize({"--together", list, "-o", directory_ / "out.npy"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json summary = ParseJson(outcome.out);
  EXPECT_EQ(summary["dims"], (json{16, 4, 4}));
  EXPECT_EQ(summary["input"], list);
  EXPECT_TRUE(fs::exists(directory_ / "out.npy"));
  // A matrix may be four rows.
  const json rows = {{1, 0, 0, 3}, {0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}};
  const CliOutcome same =
      Voxelize({"--together", List({{{"input", "one.glb"}}, {{"input", "one.glb"}, {"matrix", rows}}})});
  ASSERT_EQ(same.exit_code, 0) << same.err;
  EXPECT_EQ(ParseJson(same.out)["hash"], summary["hash"]);
}

TEST_F(CliTogether, MotionsGiveVelocities) {
  const auto hash = [&](const json& motion) {
    const CliOutcome outcome =
        Voxelize({"--together", List({{{"input", "one.glb"}, {"motion", motion}}}), "--target", "velocity:f32"});
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return ParseJson(outcome.out)["hash"];
  };
  const CliOutcome whole = Voxelize({directory_ / "one.glb", "--target", "velocity:f32", "--vertex-shader",
                                     "identity:linear_velocity=1/2/3,angular_velocity=0/0/2"});
  ASSERT_EQ(whole.exit_code, 0) << whole.err;
  EXPECT_EQ(hash({{"linear", {1, 2, 3}}, {"angular", {0, 0, 2}}}), ParseJson(whole.out)["hash"]);
  EXPECT_NE(hash({{"linear", {1, 2, 4}}, {"angular", {0, 0, 2}}}), ParseJson(whole.out)["hash"]);
}

TEST_F(CliTogether, WhatIsWrongInAListIsNamed) {
  const json one = {{"input", "one.glb"}};
  const auto with = [&](const char* key, const json& value) {
    json mesh = one;
    mesh[key] = value;
    return json{one, mesh};
  };
  EXPECT_THAT(Refused(json::array()), HasSubstr("meshes: at least one is expected"));
  EXPECT_THAT(Refused(json{{"a", 1}}), HasSubstr("meshes: a list is expected"));
  EXPECT_THAT(Refused({one, {{"name", "x"}}}), HasSubstr("meshes[1]: an object with an input is expected"));
  EXPECT_THAT(Refused(with("matrix", {1, 2})), HasSubstr("meshes[1].matrix: 16 numbers, row by row"));
  EXPECT_THAT(Refused(with("matrix", json(std::vector<double>(16, 0)))), HasSubstr("its last row must be 0 0 0 1"));
  json flat = moved_;
  flat[0] = 0;
  EXPECT_THAT(Refused(with("matrix", flat)), HasSubstr("singular"));
  EXPECT_THAT(Refused(with("label", 0)), HasSubstr("meshes[1].label: a whole number from 1 to 4294967295"));
  EXPECT_THAT(Refused(with("priority", 1.5)), HasSubstr("meshes[1].priority: a whole number"));
  EXPECT_THAT(Refused(with("motion", {{"speed", {1, 2, 3}}})), HasSubstr("unknown key 'speed'"));
  EXPECT_THAT(Refused(with("colour", "red")), HasSubstr("known are input, matrix, name"));
  EXPECT_THAT(Refused(json(std::vector<json>(65'536, one))), HasSubstr("65536 of them; at most 65535"));
  std::ofstream(directory_ / "list.json") << "{\"meshes\": [";
  EXPECT_THAT(Voxelize({"--together", directory_ / "list.json"}).err, HasSubstr("no JSON"));
  EXPECT_THAT(Voxelize({"--together", directory_ / "none.json"}).err, HasSubstr("none.json"));
  EXPECT_THAT(Voxelize({"--together", List({one}), directory_ / "two.glb"}).err, HasSubstr("give no IN beside it"));
  EXPECT_THAT(Voxelize({"--together"}).err, HasSubstr("IN is required"));
  EXPECT_THAT(Voxelize({directory_ / "one.glb", "--together", "-o", directory_ / "one.glb"}).err, HasSubstr("one.glb"));
  const CliOutcome missing = Voxelize({"--together", List({one, {{"input", "three.glb"}}})});
  EXPECT_EQ(missing.exit_code, 1);
  EXPECT_THAT(missing.err, HasSubstr("three.glb"));
}

TEST_F(CliTogether, AManifestPlacesMeshesToo) {
  const auto run = [&](const json& meshes) {
    std::ofstream(directory_ / "jobs.jsonl") << json{{"meshes", meshes}, {"id", "both"}, {"voxel_size", 0.25}}.dump();
    const CliOutcome outcome =
        RunCli({"batch", directory_ / "jobs.jsonl", "--output-dir", directory_ / "out", "--json"});
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return outcome.out;
  };
  const json placed = {{{"input", "one.glb"}}, {{"input", "one.glb"}, {"matrix", moved_}}};
  const std::string list = List(placed);
  EXPECT_EQ(Voxelize({"--together", list, "-o", directory_ / "both.npy"}).exit_code, 0);
  EXPECT_THAT(run(placed), HasSubstr("\"done\":1"));
  const std::string bytes = Contents(directory_ / "both.npy");
  EXPECT_FALSE(bytes.empty());
  EXPECT_TRUE(Contents(directory_ / "out/both.npy") == bytes);
  EXPECT_THAT(run(placed), HasSubstr("\"skipped\":1")) << "done already";
  json further = placed;
  further[1]["matrix"][3] = 4;
  EXPECT_THAT(run(further), HasSubstr("\"skipped\":0")) << "another place is another result";
  std::ofstream(directory_ / "jobs.jsonl") << json{{"meshes", placed}, {"input", "one.glb"}}.dump();
  EXPECT_THAT(RunCli({"batch", directory_ / "jobs.jsonl", "--output-dir", directory_ / "out"}).err,
              HasSubstr("exclude each other"));
}

}  // namespace
}  // namespace voxelpipe
