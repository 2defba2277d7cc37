// `voxelpipe aggregate`: reports of real runs as one.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
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
using testing::ReadFile;
using testing::RunCli;
using testing::TemporaryDirectory;
using testing::WriteBoxGlb;

class CliAggregate : public ::testing::Test {
 protected:
  CliAggregate() { WriteBoxGlb(directory_ / "a.glb", 1, 1, 1); }

  void WriteList(const std::vector<std::string>& inputs) {
    std::ofstream list(list_, std::ios::trunc);
    for (size_t i = 0; i < inputs.size(); ++i)
      list << json{{"input", inputs[i]}, {"id", "m" + std::to_string(i)}} << "\n";
  }
  // The path of the report.
  std::string Batch(const std::string& shard, int exit_code = 0, const std::string& list = "") {
    const std::string report = directory_ / ("report" + std::to_string(runs_++) + ".json");
    const CliOutcome outcome = RunCli({"batch", list.empty() ? list_ : list, "--output-dir", directory_ / "out",
                                       "--resolution", "8", "--shard", shard, "--report", report});
    EXPECT_EQ(outcome.exit_code, exit_code) << outcome.err;
    return report;
  }
  json Aggregate(std::vector<std::string> arguments, int exit_code) {
    arguments.insert(arguments.begin(), "aggregate");
    arguments.push_back("--json");
    const CliOutcome outcome = RunCli(arguments);
    EXPECT_EQ(outcome.exit_code, exit_code) << outcome.err << outcome.out;
    const json all = ParseJson(outcome.out);
    EXPECT_EQ(all["items"].get<int>(), all["done"].get<int>() + all["failed"].get<int>() + all["missing"].get<int>());
    EXPECT_EQ(all["failed"], all["failed_items"].size());
    EXPECT_EQ(all["missing"], all["missing_items"].size());
    return all;
  }
  std::string Refused(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "aggregate");
    const CliOutcome outcome = RunCli(arguments);
    EXPECT_EQ(outcome.exit_code, 2) << outcome.out;
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
    EXPECT_EQ(outcome.out, "");
    return outcome.err;
  }
  static std::string Text(const std::string& path) {
    const std::vector<uint8_t> bytes = ReadFile(path);
    return {bytes.begin(), bytes.end()};
  }
  // A report with this outcome of its first item in place of its own.
  std::string Edited(const std::string& report, const json& changes) {
    json edited = ParseJson(ReadFile(report));
    edited["items"][0].merge_patch(changes);
    std::ofstream(report, std::ios::trunc) << edited;
    return report;
  }

  TemporaryDirectory directory_;
  const std::string list_ = directory_ / "list.jsonl";
  int runs_ = 0;
};

TEST_F(CliAggregate, ReportsOfAllShardsAreTheWhole) {
  WriteList(std::vector<std::string>(7, "a.glb"));
  std::vector<std::string> reports = {Batch("0/3"), Batch("1/3"), Batch("2/3")};
  const json all = Aggregate(reports, 0);
  EXPECT_EQ(all["items"], 7);
  EXPECT_EQ(all["done"], 7);
  EXPECT_EQ(all["reports"], 3);
  EXPECT_EQ(all["warned"], 0);
  EXPECT_EQ(all["repeated"], 0);
  EXPECT_EQ(all["bytes"], 7 * 8 * 8 * 8 / 8);
  EXPECT_TRUE(all["shards_without_report"].empty());
  // Other shards over the same directory do nothing, and change nothing.
  for (const char* shard : {"0/2", "1/2"}) reports.push_back(Batch(shard));
  EXPECT_EQ(Aggregate(reports, 0)["repeated"], 0);
}

TEST_F(CliAggregate, WhatNoReportHasIsMissingAndTheRetryListMendsIt) {
  WriteList(std::vector<std::string>(6, "a.glb"));
  const std::string retry = directory_ / "retry.jsonl";
  const std::string first = Batch("0/3");
  const json all = Aggregate({first, "--retry-list", retry}, 1);
  EXPECT_EQ(all["done"], 2);
  EXPECT_EQ(all["missing"], 4);
  EXPECT_EQ(all["missing_items"][0], (json{{"line", 2}, {"id", "m1"}}));
  EXPECT_EQ(all["shards_without_report"], (json{"1/3", "2/3"}));
  const std::string list = Text(list_);
  std::string expected;
  for (const size_t line : {1, 2, 4, 5}) {
    size_t begin = 0;
    for (size_t i = 0; i < line; ++i) begin = list.find('\n', begin) + 1;
    expected += list.substr(begin, list.find('\n', begin) + 1 - begin);
  }
  EXPECT_EQ(Text(retry), expected) << "the same lines";
  EXPECT_EQ(Aggregate({Batch("0/1", 0, retry)}, 0)["done"], 4);
  EXPECT_EQ(Aggregate({Batch("0/1"), first, "--retry-list", retry}, 0)["done"], 6);
  EXPECT_EQ(Text(retry), "");
}

TEST_F(CliAggregate, ARetryListInAnotherDirectoryFindsTheSameFiles) {
  std::ofstream(directory_ / "grid.json") << R"({"origin":[0,0,0],"voxel_size":[0.5,0.5,0.5],"dims":[2,2,2]})";
  std::ofstream(list_) << R"({"input":"a.glb","id":"x"})"
                       << "\n"
                       << R"({"input":"a.glb"})"
                       << "\n"
                       << R"({"meshes":[{"input":"a.glb"}],"id":"y","grid_like":"grid.json"})"
                       << "\n";
  fs::create_directories(directory_ / "elsewhere");
  const std::string retry = directory_ / "elsewhere/retry.jsonl";
  Aggregate({Batch("0/3"), "--retry-list", retry}, 1);
  EXPECT_EQ(LineCount(Text(retry)), 2u);
  Batch("0/1", 0, retry);
  EXPECT_TRUE(fs::exists(directory_ / "out/a.npy")) << "named by its input, wherever that is";
  EXPECT_TRUE(fs::exists(directory_ / "out/y.npy"));
}

TEST_F(CliAggregate, FailuresAreCountedByReasonAndPermanentOnesAloneExitWith3) {
  std::ofstream(directory_ / "bad.glb") << "glTF but not really";
  std::ofstream(directory_ / "worse.glb") << "glTF but not really, no";
  WriteList({"none1.glb", "a.glb", "none22.glb", "bad.glb", "none3.glb", "worse.glb"});
  const json all = Aggregate({Batch("0/2", 3), Batch("1/2", 3)}, 3);
  EXPECT_EQ(all["failed"], 5);
  EXPECT_EQ(all["permanent"], 5);
  EXPECT_EQ(all["done"], 1);
  std::map<std::string, int> counts;
  for (const json& reason : all["reasons"]) counts[reason["code"]] += reason["count"].get<int>();
  EXPECT_EQ(counts, (std::map<std::string, int>{{"INVALID_ARGUMENT", 2}, {"NOT_FOUND", 3}}));
  const auto not_found = std::find_if(all["reasons"].begin(), all["reasons"].end(),
                                      [](const json& reason) { return reason["code"] == "NOT_FOUND"; });
  EXPECT_EQ((*not_found)["count"], 3) << "one reason, whatever the file: " << all["reasons"];
  EXPECT_EQ((*not_found)["example"], (json{{"line", 1}, {"id", "m0"}}));
  EXPECT_THAT(all["failed_items"][0]["message"].get<std::string>(), HasSubstr("none1.glb"));
  const CliOutcome table = RunCli({"aggregate", directory_ / "report0.json", directory_ / "report1.json"});
  EXPECT_EQ(table.exit_code, 3);
  EXPECT_THAT(table.out, HasSubstr("3 x NOT_FOUND: "));
  EXPECT_THAT(table.out, HasSubstr("5, 5 of them permanently"));
}

TEST_F(CliAggregate, AnErrorThatMayPassExitsWith1) {
  WriteList({"a.glb", "a.glb"});
  const std::string report = Edited(
      Batch("0/1"), {{"status", "failed"},
                     {"error", {{"code", "UNAVAILABLE"}, {"message", "the server is away"}, {"permanent", false}}}});
  const json all = Aggregate({report}, 1);
  EXPECT_EQ(all["permanent"], 0);
  EXPECT_EQ(all["reasons"][0]["reason"], "the server is away");
  EXPECT_EQ(all["reasons"][0]["permanent"], false);
}

TEST_F(CliAggregate, OfAnItemInSeveralReportsTheLastCounts) {
  WriteList({"late.glb", "a.glb"});
  const std::string failed = Batch("0/1", 3);
  WriteBoxGlb(directory_ / "late.glb", 1, 2, 1);
  const std::string done = Batch("0/1");
  EXPECT_EQ(Aggregate({done, failed}, 0)["done"], 2);
  EXPECT_EQ(Aggregate({failed, done}, 0)["repeated"], 0);
  WriteBoxGlb(directory_ / "a.glb", 2, 2, 2);
  const std::string changed = Batch("0/1");
  EXPECT_EQ(Aggregate({changed, failed, done}, 0)["repeated"], 1) << "two runs made it, of two inputs";
  fs::remove(directory_ / "late.glb");
  EXPECT_EQ(Aggregate({Batch("0/1", 3), done, changed}, 3)["failed"], 1);
}

TEST_F(CliAggregate, WhatDoesNotBelongTogetherIsRefused) {
  WriteList({"a.glb"});
  const std::string report = Batch("0/1");
  EXPECT_THAT(Refused({directory_ / "none.json"}), HasSubstr("none.json: cannot be read"));
  std::ofstream(directory_ / "text.json") << "{\"items\": [";
  EXPECT_THAT(Refused({directory_ / "text.json"}), HasSubstr("text.json: is no report of batch"));
  std::ofstream(directory_ / "other.json") << "{\"items\": [{\"line\": 1}]}";
  EXPECT_THAT(Refused({directory_ / "other.json"}), HasSubstr("other.json: is no report of batch"));
  const std::vector<uint8_t> bytes = ReadFile(report);
  const std::string whole(bytes.begin(), bytes.end()), line = "\"line\":1";
  ASSERT_THAT(whole, HasSubstr(line));
  for (const char* number : {"0", "-1", "4294967295", "4000000000"}) {
    std::string damaged = whole;
    damaged.replace(damaged.find(line), line.size(), std::string("\"line\":") + number);
    std::ofstream(directory_ / "line.json") << damaged;
    EXPECT_THAT(Refused({directory_ / "line.json"}), HasSubstr(std::string("an item of line ") + number));
  }
  std::ofstream(directory_ / "list2.jsonl") << R"({"input":"a.glb","id":"x"})";
  const std::string other = Batch("0/1", 0, directory_ / "list2.jsonl");
  EXPECT_THAT(Refused({report, other}), HasSubstr("is of another list than"));
  WriteList({"a.glb", "a.glb"});
  EXPECT_THAT(Refused({report}), HasSubstr("list.jsonl: has changed since"));
  EXPECT_THAT(Refused({}), HasSubstr("REPORT"));
}

}  // namespace
}  // namespace voxelpipe
