// Names and texts of files do not steer the terminal that the program prints to.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "cli_runner.h"
#include "control_characters.h"
#include "support/json/json.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::CliOutcome;
using testing::ControlsIn;
using ::testing::HasSubstr;
using testing::kHostileLetters;
using testing::kHostileText;
using testing::LineCount;
using testing::ParseJson;
using testing::ReadFile;
using testing::RunCli;
using testing::TemporaryDirectory;
using testing::WriteBoxGlb;

const std::string kRaw = kHostileText + "\x9b\xff";  // a path is any bytes
const std::string kGoodName = "_Temp\u00e9rature_\u6e29\u5ea6_\U0001F321";

// One triangle with these names at everything that has one, and at an attribute, which may have no C0.
json Triangle(const std::string& name, const std::string& attribute) {
  return {
      {"asset", {{"version", "2.0"}}},
      {"extensionsUsed", {name}},
      {"scene", 0},
      {"scenes", {{{"nodes", {0}}, {"name", name}}}},
      {"nodes", {{{"mesh", 0}, {"name", name}}}},
      {"meshes",
       {{{"name", name},
         {"primitives",
          {{{"attributes", {{"POSITION", 0}, {"_" + attribute, 1}, {kGoodName, 1}}}, {"material", 0}}}}}}},
      {"materials", {{{"name", name}, {"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}}}},
      {"textures", {{{"source", 0}, {"name", name}}}},
      {"images", {{{"name", name}, {"uri", "no such " + name + ".png"}}}},
      {"buffers",
       {{{"byteLength", 48},
         {"uri",
          "data:application/octet-stream;base64,"
          "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAAAAAgQQAAoEEAAPBB"}}}},
      {"bufferViews", {{{"buffer", 0}, {"byteLength", 36}}, {{"buffer", 0}, {"byteOffset", 36}, {"byteLength", 12}}}},
      {"accessors",
       {{{"bufferView", 0}, {"componentType", 5126}, {"count", 3}, {"type", "VEC3"}},
        {{"bufferView", 1}, {"componentType", 5126}, {"count", 3}, {"type", "SCALAR"}}}}};
}

class CliTerminal : public ::testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& text) {
    std::ofstream(directory_ / name, std::ios::binary) << text;
    return directory_ / name;
  }
  // Runs it, and expects that neither stream has a control character.
  static CliOutcome Clean(const std::vector<std::string>& arguments, int exit_code) {
    CliOutcome outcome = RunCli(arguments);
    EXPECT_EQ(outcome.exit_code, exit_code) << outcome.err;
    EXPECT_EQ(ControlsIn(outcome.out), "") << arguments[0];
    EXPECT_EQ(ControlsIn(outcome.err), "") << arguments[0];
    return outcome;
  }

  TemporaryDirectory directory_;
};

TEST_F(CliTerminal, NamesInAFileDoNotSteerIt) {
  const std::string mesh = Write("a.gltf", Triangle(kHostileText, kHostileLetters).dump());
  const CliOutcome table = Clean({"info", mesh}, 0);
  EXPECT_THAT(table.out, HasSubstr("_??31m?????????end, 1 component"));
  EXPECT_THAT(table.out, HasSubstr(kGoodName));
  const CliOutcome harmless = Clean({"info", Write("b.gltf", Triangle("name", "letters").dump())}, 0);
  EXPECT_EQ(LineCount(table.out), LineCount(harmless.out)) << "a name began another line";
  const CliOutcome text = Clean({"info", mesh, "--json"}, 0);
  EXPECT_THAT(text.out, HasSubstr(kGoodName));
  std::vector<std::string> names;
  const json about = ParseJson(text.out);
  for (const json& attribute : about["attributes"]) names.push_back(attribute["name"]);
  EXPECT_THAT(names, ::testing::Contains("_" + kHostileLetters)) << "JSON escapes it";

  const CliOutcome warned = Clean({"voxelize", mesh, "--resolution", "4", "--target", "f32:max:shader=base_color"}, 0);
  EXPECT_THAT(warned.err, HasSubstr("warning"));
  Clean(
      {"voxelize", mesh, "--resolution", "4", "--target", "f32:max:shader=base_color", "--json", "--progress", "json"},
      0);
  Clean({"voxelize", mesh, "--strict", "--target", "f32:max:shader=base_color"}, 1);
  json required = Triangle(kHostileText, kHostileLetters);
  required["extensionsRequired"] = {kHostileText};
  const CliOutcome error = Clean({"voxelize", Write("c.gltf", required.dump())}, 1);
  EXPECT_EQ(LineCount(error.err), 1u);
  EXPECT_THAT(error.err, HasSubstr("title"));
}

TEST_F(CliTerminal, NamesOfFilesDoNotSteerIt) {
  const std::string mesh = directory_ / (kRaw + ".glb"), result = directory_ / (kRaw + ".npy");
  WriteBoxGlb(mesh, 1, 1, 1);
  Clean({"info", mesh}, 0);
  const CliOutcome text = Clean({"info", mesh, "--json"}, 0);
  EXPECT_THAT(ParseJson(text.out)["input"].get<std::string>(), HasSubstr(kHostileText));
  Clean({"voxelize", mesh, "--resolution", "4", "-o", result}, 0);
  Clean({"voxelize", mesh, mesh, "--resolution", "4", "-o", directory_ / kRaw, "--progress", "json"}, 2);
  Clean({"voxelize", mesh, "--resolution", "4", "-o", result, "--json"}, 0);
  Clean({"compare", result, result}, 0);
  Clean({"compare", result, result, "--json"}, 0);
  Clean({"compare", result, directory_ / ("no " + kRaw + ".npy")}, 2);
  Clean({"info", directory_ / ("no " + kRaw)}, 2);  // a pattern: it has a bracket
  Clean({"voxelize", mesh, "--" + kHostileText}, 2);
  Clean({kHostileText}, 2);
}

TEST_F(CliTerminal, ABatchAndItsReportAreClean) {
  WriteBoxGlb(directory_ / "box.glb", 1, 1, 1);
  Write("warned.gltf", Triangle(kHostileText, kHostileLetters).dump());
  const auto item = [](const std::string& id, const std::string& input) {
    return json{{"id", id}, {"input", input}, {"output", "out" + std::to_string(input.size()) + ".npy"}}.dump() + "\n";
  };
  const std::string manifest =
      Write(kRaw + ".jsonl", item(kHostileText, "box.glb") + item("b" + kHostileText, "warned.gltf") +
                                 item("c" + kHostileText, "no" + kHostileText + ".glb"));
  const std::string report = directory_ / "report.json";
  const std::vector<std::string> batch = {
      "batch",        manifest, "--output-dir", directory_ / "out",         "--report", report,
      "--resolution", "4",      "--target",     "f32:max:shader=base_color"};
  const CliOutcome outcome = Clean(batch, 3);
  EXPECT_THAT(outcome.err, HasSubstr("title")) << "the failed item is named";
  const std::vector<uint8_t> bytes = ReadFile(report);
  const std::string text(bytes.begin(), bytes.end());
  EXPECT_EQ(ControlsIn(text), "");
  EXPECT_EQ(ParseJson(text)["items"][0]["id"], kHostileText);
  Clean({"batch", Write("bad.jsonl", json{{kHostileText, 1}}.dump() + "\n"), "--output-dir", directory_ / "out"}, 2);
}

TEST_F(CliTerminal, AResultOnStandardOutputStaysAsItIsAndItsSummaryIsClean) {
  const std::string mesh = directory_ / (kRaw + ".glb"), file = directory_ / "file.npy", piped = directory_ / "piped";
  WriteBoxGlb(mesh, 1, 1, 1);
  const std::vector<std::string> request = {"voxelize", mesh, "--resolution", "8", "--target", "f32:max:shader=normal",
                                            "-o"};
  std::vector<std::string> to_file = request, to_output = request;
  to_file.push_back(file);
  to_output.insert(to_output.end(), {"-", "--format", "npy"});
  ASSERT_EQ(RunCli(to_file).exit_code, 0);
  const CliOutcome outcome = RunCli(to_output, "", ">" + testing::ShellQuoted(piped));
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(ReadFile(piped), ReadFile(file));
  EXPECT_EQ(ControlsIn(outcome.err), "");
  EXPECT_THAT(outcome.err, HasSubstr("title"));
}

}  // namespace
}  // namespace voxelpipe
