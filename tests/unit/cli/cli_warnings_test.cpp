// What is wrong with an input is said: on stderr, in JSON, in the batch report, and by --strict as an error.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "cli_runner.h"
#include "support/json/json.h"
#include "support/meshes/glb_builder.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::CliOutcome;
using testing::GlbBuilder;
using ::testing::HasSubstr;
using testing::LineCount;
using ::testing::Not;
using testing::ParseJson;
using testing::RunCli;
using testing::TemporaryDirectory;

class CliWarnings : public ::testing::Test {
 protected:
  // A textured cube whose image is a file beside it that is not there.
  static GlbBuilder Textured() {
    GlbBuilder builder;
    const testing::Shape cube = testing::CubeShape();
    json primitive = builder.Primitive(cube.positions, cube.indices);
    primitive["attributes"]["TEXCOORD_0"] = builder.Vectors(std::vector<float>(16, 0.5f), "VEC2");
    primitive["material"] = 0;
    builder.Scene({builder.Node({{"mesh", builder.Mesh(primitive)}})});
    builder.doc["images"] = {{{"uri", "gone.png"}}};
    builder.doc["textures"] = {{{"source", 0}}};
    builder.doc["materials"] = {
        {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}, {"baseColorFactor", {1, 0.25, 0, 1}}}}}};
    return builder;
  }
  std::string Write(const std::string& name, const testing::ByteVector& bytes) const {
    const std::string path = directory_ / name;
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes.data()), std::streamsize(bytes.size()));
    return path;
  }

  const TemporaryDirectory directory_;
};

TEST_F(CliWarnings, AMissingTextureIsNeverSilent) {
  const std::string mesh = Write("textured.glb", Textured().Glb());
  const std::vector<std::string> run = {"voxelize", mesh, "--resolution", "4", "--shader", "base_color", "--json"};
  const CliOutcome colours = RunCli(run);
  ASSERT_EQ(colours.exit_code, 0) << colours.err;
  EXPECT_EQ(LineCount(colours.err), 1u);
  EXPECT_THAT(colours.err, HasSubstr("textured.glb: warning: image 0: the URI 'gone.png'"));
  const json warnings = ParseJson(colours.out)["warnings"];
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_EQ(warnings[0]["code"], "texture_missing");
  EXPECT_EQ(warnings[0]["place"], "image 0");
  EXPECT_THAT(warnings[0]["text"], HasSubstr("the material's factor is used"));

  const CliOutcome plain = RunCli({"voxelize", mesh, "--resolution", "4", "--json"});
  EXPECT_EQ(plain.err, "") << "nobody reads the texture";
  EXPECT_EQ(ParseJson(plain.out)["warnings"], json::array());
  EXPECT_THAT(RunCli({"info", mesh}).out, HasSubstr("image 0: the URI 'gone.png'"));
}

TEST_F(CliWarnings, StrictMakesTheFirstOneTheError) {
  const std::string mesh = Write("textured.glb", Textured().Glb());
  std::vector<std::string> run = {"voxelize", mesh, "--resolution", "4", "--shader", "base_color", "--strict"};
  const CliOutcome refused = RunCli(run);
  EXPECT_EQ(refused.exit_code, 1);
  EXPECT_EQ(LineCount(refused.err), 1u) << "its error alone";
  EXPECT_THAT(refused.err, HasSubstr("textured.glb: image 0: the URI 'gone.png'"));
  EXPECT_THAT(refused.err, Not(HasSubstr("warning")));
  EXPECT_EQ(RunCli({"voxelize", mesh, "--resolution", "4", "--strict"}).exit_code, 0);
}

TEST_F(CliWarnings, FiveLinesAndHowManyMore) {
  GlbBuilder builder;
  std::vector<int> roots;
  const testing::Shape cube = testing::CubeShape();
  for (int i = 0; i < 130; ++i) {
    std::vector<uint32_t> indices = cube.indices;
    indices.push_back(0);
    roots.push_back(builder.Node({{"mesh", builder.Mesh(builder.Primitive(cube.positions, indices))}}));
  }
  builder.Scene(roots);
  const CliOutcome run = RunCli({"voxelize", Write("left.glb", builder.Glb()), "--resolution", "4", "--json"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_EQ(LineCount(run.err), 6u) << run.err;
  EXPECT_THAT(run.err, HasSubstr("left.glb: warning: mesh 4, primitive 0: indices left over"));
  EXPECT_THAT(run.err, HasSubstr("left.glb: warning: and 125 more\n"));
  const json report = ParseJson(run.out);
  EXPECT_EQ(report["warnings"].size(), 100u);
  EXPECT_EQ(report["warnings_left_out"], 30);
}

// What packing takes away is said, too: a text file with a byte order mark and files beside it becomes a GLB.
TEST_F(CliWarnings, OfPackedFiles) {
  GlbBuilder builder = Textured();
  builder.doc["buffers"] = {{{"uri", "cube.bin"}, {"byteLength", builder.bin.size()}}};
  builder.doc.erase("images");
  builder.doc.erase("textures");
  builder.doc.erase("materials");
  builder.doc["meshes"][0]["primitives"][0].erase("material");
  Write("cube.bin", builder.bin);
  const std::string text = "\xEF\xBB\xBF" + builder.doc.dump();
  const std::string mesh = Write("marked.gltf", {text.begin(), text.end()});
  const CliOutcome run = RunCli({"voxelize", mesh, "--resolution", "4"});
  ASSERT_EQ(run.exit_code, 0) << run.err;
  EXPECT_THAT(run.err, HasSubstr("marked.gltf: warning: the JSON begins with a byte order mark"));
  EXPECT_EQ(RunCli({"voxelize", mesh, "--resolution", "4", "--strict"}).exit_code, 1);
  EXPECT_THAT(RunCli({"info", mesh}).out, HasSubstr("byte order mark"));
}

TEST_F(CliWarnings, OfABatchStandWithTheirItems) {
  Write("textured.glb", Textured().Glb());
  Write("plain.glb", testing::CubeGlb());
  std::ofstream(directory_ / "list.jsonl") << R"({"input":"textured.glb","shader":"base_color"})" << '\n'
                                           << R"({"input":"plain.glb"})" << '\n';
  const std::vector<std::string> command = {
      "batch",    directory_ / "list.jsonl", "--output-dir", directory_ / "out", "--resolution", "4",
      "--report", directory_ / "report.json"};
  for (const char* status : {"done", "skipped"}) {
    const CliOutcome run = RunCli(command);
    ASSERT_EQ(run.exit_code, 0) << run.err;
    EXPECT_THAT(run.err, HasSubstr("warning: textured: image 0: the URI 'gone.png'")) << status;
    EXPECT_THAT(run.out, HasSubstr(", 1 with warnings"));
    const std::vector<uint8_t> bytes = testing::ReadFile(directory_ / "report.json");
    const json report = ParseJson(bytes);
    EXPECT_EQ(report["totals"]["warned"], 1);
    EXPECT_EQ(report["items"][0]["status"], status);
    ASSERT_EQ(report["items"][0]["warnings"].size(), 1u) << "also of what a run before has done";
    EXPECT_EQ(report["items"][0]["warnings"][0]["code"], "texture_missing");
    EXPECT_EQ(report["items"][1]["warnings"], json::array());
  }
  std::ofstream(directory_ / "list.jsonl") << R"({"input":"textured.glb","shader":"base_color","strict":true})" << '\n';
  const CliOutcome strict = RunCli(command);
  EXPECT_EQ(strict.exit_code, 3) << "what was done for a lenient item is not what a strict one asks for";
  EXPECT_THAT(strict.err, HasSubstr("image 0: the URI 'gone.png'"));
}

}  // namespace
}  // namespace voxelpipe
