// Directories and patterns as inputs of the real command.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <sstream>

#include "cli_runner.h"

#include "support/json/json.h"

namespace voxelpipe {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::CliOutcome;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::LineCount;
using testing::ParseJson;
using testing::RunCli;
using testing::TemporaryDirectory;
using testing::WriteBoxGlb;

class CliInputs : public ::testing::Test {
 protected:
  CliInputs() {
    for (const char* file : {"m/b.glb", "m/a.glb", "m/sub/a.glb"}) {
      fs::create_directories((directory_.path() / file).parent_path());
      WriteBoxGlb(directory_ / file, 1, 1, 1);
    }
  }

  CliOutcome Voxelize(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), {"voxelize", "--resolution", "4", "--json"});
    return RunCli(arguments);
  }
  // The inputs of the summaries, below the test's directory.
  std::vector<std::string> Inputs(const CliOutcome& outcome) {
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    std::vector<std::string> inputs;
    std::istringstream lines(outcome.out);
    for (std::string line; std::getline(lines, line);) {
      const std::string path = ParseJson(line)["input"];
      inputs.push_back(fs::path(path).lexically_relative(directory_.path()).string());
    }
    return inputs;
  }

  TemporaryDirectory directory_;
};

TEST_F(CliInputs, ADirectoryIsVoxelizedInOrderIntoTheSameFolders) {
  EXPECT_THAT(Inputs(Voxelize({directory_ / "m"})), ElementsAre("m/a.glb", "m/b.glb"));
  const CliOutcome all = Voxelize({directory_ / "m", "--recursive", "-o", directory_ / "out", "--format", "npz",
                                   "--preview", directory_ / "pictures"});
  EXPECT_THAT(Inputs(all), ElementsAre("m/a.glb", "m/b.glb", "m/sub/a.glb"));
  for (const char* file : {"out/a.npz", "out/b.npz", "out/sub/a.npz", "pictures/sub/a.png"}) {
    EXPECT_TRUE(fs::exists(directory_ / file)) << file;
  }
}

TEST_F(CliInputs, AQuotedPatternIsExpanded) {
  EXPECT_THAT(Inputs(Voxelize({directory_ / "m/**/a.glb", "-o", directory_ / "out"})),
              ElementsAre("m/a.glb", "m/sub/a.glb"));
  EXPECT_TRUE(fs::exists(directory_ / "out/sub/a.npy"));
}

TEST_F(CliInputs, OneNameForTwoInputsIsRefusedBeforeAnyWork) {
  const CliOutcome outcome =
      Voxelize({directory_ / "m/b.glb", directory_ / "m/a.glb", directory_ / "m/sub/a.glb", "-o", directory_ / "out"});
  EXPECT_EQ(outcome.exit_code, 2);
  EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("would both become"));
  EXPECT_FALSE(fs::exists(directory_ / "out"));
  EXPECT_EQ(outcome.out, "");
}

TEST_F(CliInputs, ListsThatCannotBeExitWith2) {
  for (const std::vector<std::string>& arguments : {std::vector<std::string>{directory_ / "m/*.drc"},
                                                    {directory_ / "m", "-o", directory_ / "out.npy"},
                                                    {directory_ / "m/a.glb", "--recursive"},
                                                    {directory_ / "m/a*", "-o", "-", "--format", "npy"}}) {
    const CliOutcome outcome = Voxelize(arguments);
    EXPECT_EQ(outcome.exit_code, 2) << ::testing::PrintToString(arguments);
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
  }
}

}  // namespace
}  // namespace voxelpipe
