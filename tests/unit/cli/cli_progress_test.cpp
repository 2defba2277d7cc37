// Progress on standard error.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <sstream>

#include "cli_runner.h"
#include "support/json/json.h"
#include "terminal.h"

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
using testing::Terminal;
using testing::WriteBoxGlb;

class CliProgress : public ::testing::Test {
 protected:
  CliProgress() : box_(directory_ / "box.glb") { WriteBoxGlb(box_, 1, 2, 4); }

  static std::vector<json> Events(const std::string& lines) {
    std::vector<json> events;
    std::istringstream in(lines);
    for (std::string line; std::getline(in, line);) {
      events.push_back(ParseJson(line, false));
      for (const char* key : {"stage", "fraction", "item", "items", "elapsed_ms", "eta_ms"}) {
        EXPECT_TRUE(events.back().contains(key)) << line;
      }
    }
    return events;
  }

  TemporaryDirectory directory_;
  std::string box_;
};

TEST_F(CliProgress, JsonLinesTellTheStagesOfAMeshAndLeaveStandardOutputAlone) {
  const CliOutcome outcome = RunCli({"voxelize", box_, "--resolution", "8", "--json", "--progress", "json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  EXPECT_EQ(ParseJson(outcome.out)["triangles"], 12);
  const std::vector<json> events = Events(outcome.err);
  std::vector<std::string> stages;
  for (const json& event : events) {
    if (stages.empty() || stages.back() != event["stage"]) stages.push_back(event["stage"]);
    EXPECT_EQ(event["items"], 1);
    EXPECT_TRUE(event["eta_ms"].is_null());
  }
  ASSERT_GE(stages.size(), 4u) << outcome.err;
  EXPECT_EQ(stages.front(), "load");
  EXPECT_EQ(stages.back(), "done");
}

TEST_F(CliProgress, JsonLinesOfAListCountItemsToTheEnd) {
  WriteBoxGlb(directory_ / "cube.glb", 1, 1, 1);
  const CliOutcome outcome =
      RunCli({"voxelize", box_, directory_ / "cube.glb", "--resolution", "8", "--progress", "json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const std::vector<json> events = Events(outcome.err);
  ASSERT_FALSE(events.empty());
  EXPECT_EQ(events.front()["item"], 1);
  EXPECT_TRUE(events.front()["eta_ms"].is_null());
  EXPECT_EQ(events.back()["item"], 2);
  EXPECT_EQ(events.back()["items"], 2);
  EXPECT_EQ(events.back()["fraction"], 1);
  EXPECT_EQ(events.back()["eta_ms"], 0);
}

TEST_F(CliProgress, ABatchTellsHowManyItemsHaveEnded) {
  std::ofstream(directory_ / "list.jsonl") << R"({"input":"box.glb"})"
                                           << "\n"
                                           << R"({"input":"box.glb","id":"b"})";
  const CliOutcome outcome = RunCli({"batch", directory_ / "list.jsonl", "--output-dir", directory_ / "out",
                                     "--resolution", "4", "--progress", "json", "--json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const std::vector<json> events = Events(outcome.err);
  ASSERT_FALSE(events.empty());
  EXPECT_EQ(events.back()["stage"], "done");
  EXPECT_EQ(events.back()["item"], 2);
  EXPECT_EQ(events.back()["items"], 2);
  EXPECT_EQ(LineCount(outcome.out), 1u);
}

TEST_F(CliProgress, NothingIsShownOnATerminalThatAskedForNone) {
  Terminal terminal;
  if (terminal.path().empty()) GTEST_SKIP() << "this system has no pseudo-terminals";
  const CliOutcome outcome =
      RunCli({"voxelize", box_, "--resolution", "8", "--repeat", "2000", "--progress", "none", "--json"}, "",
             "2>" + terminal.path());
  ASSERT_EQ(outcome.exit_code, 0);
  EXPECT_EQ(LineCount(outcome.out), 1u);
  EXPECT_EQ(terminal.Shown(), "");
}

TEST_F(CliProgress, AnUnknownKindExitsWith2) {
  for (const char* kind : {"", "yes", "JSON"}) {
    const CliOutcome outcome = RunCli({"voxelize", box_, "--progress", kind});
    EXPECT_EQ(outcome.exit_code, 2) << kind;
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr("--progress"));
  }
}

}  // namespace
}  // namespace voxelpipe
