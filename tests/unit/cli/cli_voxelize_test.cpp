// What the commands print and write.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <sstream>

#include "cli_runner.h"

#include "support/json/json.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::CliOutcome;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::LineCount;
using testing::ParseJson;
using testing::ReadFile;
using testing::RunCli;
using testing::TemporaryDirectory;
using testing::WriteBoxGlb;

class CliVoxelize : public ::testing::Test {
 protected:
  CliVoxelize() : box_(directory_ / "box.glb") { WriteBoxGlb(box_, 2, 1, 1); }

  json VoxelizeJson(std::vector<std::string> options) {
    options.insert(options.begin(), {"voxelize", box_, "--json"});
    const CliOutcome outcome = RunCli(options);
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    EXPECT_EQ(LineCount(outcome.out), 1u);
    return ParseJson(outcome.out, false);
  }

  TemporaryDirectory directory_;
  std::string box_;
};

TEST_F(CliVoxelize, PrintsTheSummary) {
  const json summary = VoxelizeJson({"--resolution", "8"});
  EXPECT_EQ(summary["triangles"], 12);
  EXPECT_THAT(summary["dims"], ElementsAre(8, 4, 4));
  EXPECT_THAT(summary["origin"], ElementsAre(0, 0, 0));
  EXPECT_THAT(summary["voxel_size"], ElementsAre(0.25, 0.25, 0.25));
  EXPECT_EQ(summary["occupied"], 8 * 4 * 4 - 6 * 2 * 2);
  EXPECT_TRUE(summary["fragments"].is_null());  // row spans of plain bits do not count them
  EXPECT_TRUE(summary["odd_columns"].is_null());
  EXPECT_TRUE(summary["open_edges"].is_null());
  EXPECT_EQ(summary["backend"], "cpu");
  EXPECT_TRUE(summary["simd"].is_string());
  EXPECT_EQ(summary["path"], nlohmann::json::array({"occupancy"}));
  EXPECT_EQ(summary["bytes"], 16);
  EXPECT_GT(summary["peak_bytes"], 1 << 20);
  EXPECT_EQ(summary["hash"].get<std::string>().size(), 64u);
  for (const char* stage : {"load", "flatten", "vertex_shade", "plan", "fine_raster"})
    EXPECT_TRUE(summary["stages"].contains(stage)) << stage;
  EXPECT_FALSE(summary["stages"].contains("encode"));
  EXPECT_GT(summary["voxelize_ms"], 0);
  EXPECT_GE(summary["voxelize_cpu_ms"], 0);
  EXPECT_EQ(directory_.FileCount(), 1u);  // nothing is written without -o
}

TEST_F(CliVoxelize, AFillCountsOddColumnsAndOpenEdges) {
  const json summary = VoxelizeJson({"--resolution", "8", "--fill", "parity"});
  EXPECT_EQ(summary["occupied"], 8 * 4 * 4);
  EXPECT_EQ(summary["odd_columns"], 0);
  EXPECT_EQ(summary["open_edges"], 0);
  EXPECT_TRUE(summary["stages"].contains("fill"));
}

TEST_F(CliVoxelize, WritesPackedBitsAsRaw) {
  const json summary = VoxelizeJson({"--resolution", "8", "-o", directory_ / "out.raw"});
  const std::vector<uint8_t> bytes = ReadFile(directory_ / "out.raw");
  ASSERT_EQ(bytes.size(), 16u);
  size_t set = 0;
  for (const uint8_t byte : bytes) set += size_t(__builtin_popcount(byte));
  EXPECT_EQ(summary["occupied"], set);
  EXPECT_TRUE(summary["stages"].contains("encode"));
  EXPECT_THAT(summary["files"], ElementsAre(directory_ / "out.raw", directory_ / "out.raw.json"));
}

TEST_F(CliVoxelize, TheHashIsThatOfTheWrittenBytes) {
  const json summary = VoxelizeJson({"--resolution", "8", "-o", directory_ / "out.raw"});
  const CliOutcome again = RunCli({"voxelize", box_, "--resolution", "8", "--json"});
  EXPECT_EQ(ParseJson(again.out)["hash"], summary["hash"]);
  ASSERT_EQ(std::system(("cd " + directory_.path().string() + " && sha256sum out.raw > sum").c_str()), 0);
  const std::vector<uint8_t> sum = ReadFile(directory_ / "sum");
  EXPECT_EQ(std::string(sum.begin(), sum.begin() + 64), summary["hash"]);
  EXPECT_NE(VoxelizeJson({"--resolution", "9"})["hash"], summary["hash"]);
}

TEST_F(CliVoxelize, DefaultTargetIsBitsAndAnotherShaderGivesFloats) {
  EXPECT_EQ(VoxelizeJson({"--resolution", "8", "--shader", "occupancy"})["bytes"], 16);
  EXPECT_EQ(VoxelizeJson({"--resolution", "8", "--shader", "normal"})["bytes"], 128 * 3 * 4);
  EXPECT_EQ(VoxelizeJson({"--resolution", "8", "--shader", "triangle_id"})["bytes"], 128 * 4);
  EXPECT_EQ(VoxelizeJson({"--resolution", "8", "--shader", "normal", "--target", "bit:or"})["bytes"], 16);
}

TEST_F(CliVoxelize, SeveralTargetsGetNumberedFiles) {
  const json summary = VoxelizeJson({"--resolution", "8", "--target", "bit:or", "--target",
                                     "f32x3:replace:shader=constant,value=0.5/0.25/2", "-o", directory_ / "out.raw",
                                     "--preview", directory_ / "look.png"});
  EXPECT_EQ(summary["bytes"], 16 + 128 * 12);
  EXPECT_THAT(summary["files"], ElementsAre(directory_ / "out.0.raw", directory_ / "out.1.raw",
                                            directory_ / "out.raw.json", directory_ / "look.png"));
  EXPECT_EQ(ReadFile(directory_ / "out.0.raw").size(), 16u);
  const std::vector<uint8_t> floats = ReadFile(directory_ / "out.1.raw");
  ASSERT_EQ(floats.size(), 128u * 12);
  float first[3];
  std::memcpy(first, floats.data(), 12);
  EXPECT_THAT(first, ElementsAre(0.5f, 0.25f, 2.0f));
  EXPECT_EQ(directory_.FileCount(), 5u);
}

TEST_F(CliVoxelize, PicturesAreWrittenByEitherOption) {
  VoxelizeJson({"--resolution", "8", "-o", directory_ / "a.png"});
  VoxelizeJson({"--resolution", "8", "--preview", directory_ / "b.png"});
  const std::vector<uint8_t> picture = ReadFile(directory_ / "a.png");
  EXPECT_GT(picture.size(), 1000u);
  EXPECT_EQ(std::string(picture.begin(), picture.begin() + 8), "\x89PNG\r\n\x1a\n");
  EXPECT_EQ(picture, ReadFile(directory_ / "b.png"));
}

TEST_F(CliVoxelize, PicturesAreTakenFromTheViewThatIsGiven) {
  const auto picture = [&](const std::vector<std::string>& options, const std::string& name) {
    std::vector<std::string> all = {"--resolution", "8"};
    all.insert(all.end(), options.begin(), options.end());
    VoxelizeJson(all);
    return ReadFile(directory_ / name);
  };
  const auto usual = picture({"--preview", directory_ / "a.png"}, "a.png");
  EXPECT_EQ(picture({"--preview", directory_ / "b.png", "--view", "iso"}, "b.png"), usual);
  const auto front = picture({"--preview", directory_ / "c.png", "--view", "front"}, "c.png");
  EXPECT_NE(front, usual);
  EXPECT_EQ(picture({"-o", directory_ / "d.png", "--view", "0,0"}, "d.png"), front);
}

TEST_F(CliVoxelize, SeveralInputsGiveALineAndAFileEach) {
  std::filesystem::create_directory(directory_ / "other");
  WriteBoxGlb(directory_ / "other/cube.glb", 1, 1, 1);
  const CliOutcome outcome = RunCli({"voxelize", box_, directory_ / "missing.glb", directory_ / "other/cube.glb",
                                     "--resolution", "8", "-o", directory_ / "results", "--json"});
  EXPECT_EQ(outcome.exit_code, 1);  // one of them failed, the others are done
  EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("missing.glb"));
  std::istringstream lines(outcome.out);
  std::vector<json> objects;
  for (std::string line; std::getline(lines, line);) objects.push_back(ParseJson(line));
  ASSERT_EQ(objects.size(), 2u);
  EXPECT_THAT(objects[0]["files"], ElementsAre(directory_ / "results/box.npy"));
  EXPECT_THAT(objects[1]["files"], ElementsAre(directory_ / "results/cube.npy"));
  EXPECT_EQ(objects[0]["dims"], json({8, 4, 4}));
  EXPECT_EQ(objects[1]["dims"], json({8, 8, 8}));
  EXPECT_GT(ReadFile(directory_ / "results/cube.npy").size(), 512u);
}

TEST_F(CliVoxelize, SeveralInputsRefuseOneFile) {
  const CliOutcome outcome = RunCli({"voxelize", box_, box_, "-o", directory_ / "out.npy"});
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_THAT(outcome.err, HasSubstr("directory"));
}

TEST_F(CliVoxelize, RepeatGivesTheLeastCpuTimeAndTheSameBytes) {
  const json once = VoxelizeJson({"--resolution", "16"});
  const json summary = VoxelizeJson({"--resolution", "16", "--repeat", "5"});
  EXPECT_EQ(summary["hash"], once["hash"]);
  EXPECT_FALSE(once.contains("voxelize_cpu_ms_min"));
  EXPECT_LE(summary["voxelize_cpu_ms_min"], summary["voxelize_cpu_ms"]);
}

TEST_F(CliVoxelize, TakesAGridThatIsGiven) {
  const json summary = VoxelizeJson({"--dims", "3,4,5", "--origin", "-1,-1,-1", "--voxel-size", "1,0.5,2"});
  EXPECT_THAT(summary["dims"], ElementsAre(3, 4, 5));
  EXPECT_THAT(summary["origin"], ElementsAre(-1, -1, -1));
  EXPECT_THAT(summary["voxel_size"], ElementsAre(1, 0.5, 2));
}

TEST_F(CliVoxelize, InfoReportsTheMesh) {
  const CliOutcome outcome = RunCli({"info", box_, "--json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json info = ParseJson(outcome.out);
  EXPECT_EQ(info["triangles"], 12);
  EXPECT_EQ(info["open_edges"], 0);
  EXPECT_THAT(info["max"], ElementsAre(2, 1, 1));
  EXPECT_EQ(info["format"], "glb");
  EXPECT_THAT(RunCli({"info", box_}).out, HasSubstr("closed"));
}

// A triangle with _HEAT in one primitive, and one without.
std::string WriteHeatGltf(const TemporaryDirectory& directory) {
  const std::vector<float> numbers = {0, 0, 0, 4, 0, 0, 0, 4, 0, 5, 5, 5};
  json document = {
      {"asset", {{"version", "2.0"}}},
      {"scene", 0},
      {"scenes", {{{"nodes", {0}}}}},
      {"nodes", {{{"mesh", 0}}}},
      {"buffers", {{{"byteLength", 48}, {"uri", "heat.bin"}}}},
      {"bufferViews", {{{"buffer", 0}, {"byteLength", 36}}, {{"buffer", 0}, {"byteOffset", 36}, {"byteLength", 12}}}},
      {"accessors",
       {{{"bufferView", 0}, {"componentType", 5126}, {"count", 3}, {"type", "VEC3"}},
        {{"bufferView", 1}, {"componentType", 5126}, {"count", 3}, {"type", "SCALAR"}}}}};
  document["meshes"] = json::array({{{"primitives", json::array()}}});
  document["meshes"][0]["primitives"].push_back({{"attributes", {{"POSITION", 0}, {"_HEAT", 1}}}});
  document["meshes"][0]["primitives"].push_back({{"attributes", {{"POSITION", 0}}}});
  std::ofstream(directory / "heat.bin", std::ios::binary).write(reinterpret_cast<const char*>(numbers.data()), 48);
  std::ofstream(directory / "heat.gltf") << document.dump();
  return directory / "heat.gltf";
}

TEST_F(CliVoxelize, AFilesOwnAttributesAreListedAndVoxelized) {
  const std::string mesh = WriteHeatGltf(directory_);
  const CliOutcome info = RunCli({"info", mesh, "--json"});
  ASSERT_EQ(info.exit_code, 0) << info.err;
  EXPECT_EQ(ParseJson(info.out)["attributes"], ParseJson(R"([{"name":"_HEAT","components":1}])"));
  const json warnings = ParseJson(info.out)["warnings"];
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(warnings[0]["code"], "count_mismatch");
  EXPECT_EQ(warnings[0]["place"], "attribute _HEAT");
  EXPECT_THAT(warnings[0]["text"], HasSubstr("is missing in 1 of 2 primitives"));
  EXPECT_THAT(RunCli({"info", mesh}).out, HasSubstr("_HEAT, 1 component"));
  const std::string file = directory_ / "heat.raw";
  const CliOutcome run =
      RunCli({"voxelize", mesh, "--resolution", "4", "--target", "f32x1:max:shader=attribute(_HEAT)", "-o", file});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const std::vector<uint8_t> bytes = ReadFile(file);
  ASSERT_GE(bytes.size(), 4u);
  float first;
  std::memcpy(&first, bytes.data(), 4);
  EXPECT_EQ(first, 5);
  const CliOutcome unknown = RunCli({"voxelize", mesh, "--shader", "attribute(_COLD)"});
  EXPECT_EQ(unknown.exit_code, 1);
  EXPECT_THAT(unknown.err, HasSubstr("the mesh has no attribute '_COLD' (it has _HEAT)"));
}

TEST_F(CliVoxelize, ShadersAreListed) {
  const CliOutcome outcome = RunCli({"shaders", "--json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  std::vector<std::string> names;
  const json list = ParseJson(outcome.out);
  for (const json& shader : list["shaders"]) names.push_back(shader["name"]);
  EXPECT_THAT(names,
              ::testing::IsSupersetOf({"identity", "transform", "occupancy", "constant", "triangle_id", "barycentric",
                                       "geometric_normal", "packed_normal", "normal", "base_color"}));
  for (const std::string& name : names) EXPECT_THAT(RunCli({"shaders"}).out, HasSubstr(name));
}

}  // namespace
}  // namespace voxelpipe
