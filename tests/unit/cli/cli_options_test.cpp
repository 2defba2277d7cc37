// What the command line accepts and how it refuses.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <regex>
#include <sstream>

#include "cli_runner.h"
#include "support/resources/closed_port.h"

namespace voxelpipe {
namespace {

using testing::CliOutcome;
using testing::ClosedPort;
using ::testing::HasSubstr;
using testing::LineCount;
using ::testing::Not;
using testing::RunCli;
using testing::TemporaryDirectory;
using testing::WriteBoxGlb;

class CliOptions : public ::testing::Test {
 protected:
  CliOptions() : box_(directory_ / "box.glb") { WriteBoxGlb(box_, 1, 1, 1); }

  CliOutcome Voxelize(std::vector<std::string> options) {
    options.insert(options.begin(), {"voxelize", box_});
    return RunCli(options);
  }

  TemporaryDirectory directory_;
  std::string box_;
};

TEST_F(CliOptions, HelpExplainsAndSucceeds) {
  for (const std::vector<std::string>& arguments : {std::vector<std::string>{"--help"},
                                                    {"voxelize", "--help"},
                                                    {"info", "--help"},
                                                    {"shaders", "--help"},
                                                    {"server-info", "--help"}}) {
    const CliOutcome outcome = RunCli(arguments);
    EXPECT_EQ(outcome.exit_code, 0);
    EXPECT_EQ(outcome.err, "");
    EXPECT_THAT(outcome.out, HasSubstr("voxelpipe"));
  }
  EXPECT_THAT(RunCli({"voxelize", "--help"}).out, HasSubstr("base_color:srgb8"));
  EXPECT_EQ(RunCli({"--version"}).exit_code, 0);
}

TEST_F(CliOptions, WrongOptionsExitWith2AndOneLine) {
  const std::vector<std::vector<std::string>> wrong = {
      {"--no-such-option"},
      {"--resolution", "0"},
      {"--resolution", "many"},
      {"--resolution", "8", "--resolution", "9"},
      {"--resolution", "8", "--voxel-size", "1"},
      {"--voxel-size", "-1"},
      {"--dims", "4,4,4", "--voxel-size", "1"},
      {"--fit", "loose"},
      {"--padding", "-1"},
      {"--coverage", "fat"},
      {"--fill", "maybe"},
      {"--shader", "no_such_shader"},
      {"--shader", "constant:no_such_parameter=1"},
      {"--shader", "constant:value=x"},
      {"--vertex-shader", "no_such_shader"},
      {"--target", "u7:or"},
      {"--target", "bit:max"},
      {"--target", "bit:or:scale=2"},
      {"--target", "f32:add:scale=2"},
      {"--target", "f32x5:add"},
      {"--layout", "diagonal"},
      {"--backend", "fpga"},
      {"--simd", "mmx"},
      {"--result", "octree"},
      {"--result", "buckets", "--fill", "parity"},
      {"--result", "sparse", "-o", "out.npy"},
      {"--result", "buckets", "-o", "out.raw"},
      {"--threads", "-1"},
      {"--repeat", "0"},
      {"-o", directory_ / "out.xyz"},
      {"-o", directory_ / "out"},
      {"--preview", directory_ / "out.npy"},
      {"-o", ""},
      {"--preview", ""},
      {"--preview", directory_ / "out.png", "--view", "sideways"},
      {"--preview", directory_ / "out.png", "--view", "0,91"},
      {"--view", "front"},
      {"-o", directory_ / "out.npy", "--view", "front"},
      {"--server", ""},
  };
  for (const std::vector<std::string>& options : wrong) {
    const CliOutcome outcome = Voxelize(options);
    EXPECT_EQ(outcome.exit_code, 2) << ::testing::PrintToString(options) << outcome.err;
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
    EXPECT_EQ(outcome.out, "");
  }
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{}, {"no-such-command"}, {"voxelize"}, {"info"}, {"server-info"}}) {
    const CliOutcome outcome = RunCli(arguments);
    EXPECT_EQ(outcome.exit_code, 2) << ::testing::PrintToString(arguments);
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
  }
  EXPECT_EQ(directory_.FileCount(), 1u);
}

// The options of a command that take a value, from its help.
std::vector<std::string> OptionsWithValues(const std::string& command) {
  std::istringstream help(RunCli({command, "--help"}).out);
  std::vector<std::string> options;
  for (std::string line; std::getline(help, line);) {
    std::smatch match;
    if (std::regex_search(line, match, std::regex("^  (?:-[a-z],)?(--[a-z-]+) (?!Needs:)[^ ]")))
      options.push_back(match[1]);
  }
  return options;
}

TEST_F(CliOptions, AnEmptyValueExitsWith2ForEveryOption) {
  const std::map<std::string, std::vector<std::string>> commands = {{"voxelize", {box_}}, {"info", {box_}},
                                                                    {"shaders", {}},      {"server-info", {}},
                                                                    {"batch", {"list"}},  {"bench", {box_}}};
  size_t tried = 0;
  for (const auto& [command, more] : commands) {
    for (const std::string& option : OptionsWithValues(command)) {
      std::vector<std::string> arguments = {command};
      arguments.insert(arguments.end(), more.begin(), more.end());
      arguments.insert(arguments.end(), {option, ""});
      const CliOutcome outcome = RunCli(arguments);
      EXPECT_EQ(outcome.exit_code, 2) << command << " " << option << outcome.err;
      EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
      EXPECT_THAT(outcome.err, HasSubstr(option)) << command;
      ++tried;
    }
    EXPECT_EQ(RunCli({command, ""}).exit_code, 2) << command;
  }
  EXPECT_GT(tried, 60u);
}

TEST_F(CliOptions, TheSummarySaysWhereTheGridLies) {
  const CliOutcome outcome = Voxelize({"--dims", "4,4,4", "--voxel-size", "1", "--origin", "-1,-0.25,3"});
  EXPECT_THAT(outcome.out, HasSubstr("origin      -1 -0.25 3"));
}

TEST_F(CliOptions, WrongLoadsExitWith2AndOneLine) {
  const std::vector<std::vector<std::string>> wrong = {
      {},  // for how long?
      {"--duration", "0"},
      {"--duration", "1", "--concurrency", "0"},
      {"--duration", "1", "--rate", "0"},
      {"--duration", "1", "--rate", "5", "--concurrency", "2"},
      {"--duration", "1", "--arrivals", "bursts"},
      {"--duration", "1", "--deadline-ms", "0"},
      {"--duration", "1", "--deadline-ms", "9", "--many"},
      {"--duration", "1", "--connections", "1", "--server", "127.0.0.1:2"},
      {"--duration", "1", "--server", ""},
      {"--duration", "1", "--priority", "urgent"},
      {"--duration", "1", "--max-error-rate", "1.5"},
      {"--duration", "1", "--max-error-rate", "-1"},
      {"--duration", "1", "--resolution", "0"},
  };
  const ClosedPort closed_port;
  for (const std::vector<std::string>& options : wrong) {
    std::vector<std::string> arguments = {"bench", box_, "--server", closed_port.address()};
    arguments.insert(arguments.end(), options.begin(), options.end());
    const CliOutcome outcome = RunCli(arguments);
    EXPECT_EQ(outcome.exit_code, 2) << ::testing::PrintToString(options) << outcome.err;
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
    EXPECT_EQ(outcome.out, "");
  }
  EXPECT_EQ(RunCli({"bench", box_, "--duration", "1"}).exit_code, 2);  // on which server?
}

TEST_F(CliOptions, FailedJobsExitWith1AndOneLineNamingTheFile) {
  std::ofstream(directory_ / "bad.glb") << "glTF but not really";
  std::ofstream(directory_ / "empty.glb");
  for (const std::string& path : {directory_ / "missing.glb", directory_ / "bad.glb", directory_ / "empty.glb"}) {
    for (const char* command : {"voxelize", "info"}) {
      const CliOutcome outcome = RunCli({command, path, "--json"});
      EXPECT_EQ(outcome.exit_code, 1) << path;
      EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
      EXPECT_THAT(outcome.err, HasSubstr(path));
      EXPECT_EQ(outcome.out, "");
    }
  }
}

TEST_F(CliOptions, AnUnwritablePathFailsTheJob) {
  std::ofstream(directory_ / "file") << "x";
  const CliOutcome outcome = Voxelize({"-o", directory_ / "file/out.npy", "--resolution", "4"});
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("out.npy"));
}

TEST_F(CliOptions, AskingForCudaWithoutItFailsTheJob) {
  const CliOutcome outcome = Voxelize({"--backend", "cuda", "--resolution", "4"});
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_THAT(outcome.err, HasSubstr("CUDA"));
}

TEST_F(CliOptions, AGridBeyondMemoryFailsTheJob) {
  const CliOutcome outcome = Voxelize({"--resolution", "100000", "--target", "f32x4:replace"});
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
  EXPECT_EQ(outcome.out, "");
}

TEST_F(CliOptions, NegativeNumbersAreValuesNotOptions) {
  for (const char* origin : {"-1,-1,-1", "-.5,0,0"}) {
    const CliOutcome outcome = Voxelize({"--dims", "4,4,4", "--voxel-size", "1", "--origin", origin, "--json"});
    EXPECT_EQ(outcome.exit_code, 0) << origin << outcome.err;
  }
}

TEST_F(CliOptions, ATargetDoesNotSwallowTheInputBehindIt) {
  const CliOutcome outcome = RunCli({"voxelize", "--target", "bit:or", box_, "--json"});
  EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
}

TEST_F(CliOptions, NothingIsDrawnOnAPipe) {
  const CliOutcome outcome = Voxelize({"--resolution", "64"});
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_EQ(outcome.err, "");
  EXPECT_THAT(outcome.out, Not(HasSubstr("\r")));
  EXPECT_THAT(outcome.out, HasSubstr("triangles"));
}

TEST_F(CliOptions, AServerThatIsNotThereFailsTheJob) {
#ifdef VOXELPIPE_HAVE_SERVICE
  constexpr int kExpected = 1;
#else
  constexpr int kExpected = 2;  // this build does not know the option's meaning
#endif
  const ClosedPort closed_port;
  for (const std::vector<std::string>& command : {std::vector<std::string>{"voxelize", box_},
                                                  {"info", box_},
                                                  {"shaders"},
                                                  {"server-info"},
                                                  {"bench", box_, "--duration", "1"}}) {
    std::vector<std::string> arguments = command;
    arguments.insert(arguments.end(), {"--server", closed_port.address(), "--json"});
    const CliOutcome outcome = RunCli(arguments);
    EXPECT_EQ(outcome.exit_code, kExpected) << command[0] << outcome.err;
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
    EXPECT_EQ(outcome.out, "");
  }
}

TEST_F(CliOptions, AnInterruptedJobExitsWith130AndLeavesNoFile) {
  // timeout sends SIGINT; the job would take far longer than that.
  const CliOutcome outcome =
      RunCli({"voxelize", box_, "--resolution", "256", "--target", "f32x4:replace:shader=base_color", "--repeat",
              "100000", "-o", directory_ / "out.npy"},
             "timeout --preserve-status --signal=INT 1");
  EXPECT_EQ(outcome.exit_code, 130) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("stopped"));
  EXPECT_EQ(directory_.FileCount(), 1u);
}

}  // namespace
}  // namespace voxelpipe
