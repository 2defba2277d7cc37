// `voxelpipe batch`: what a batch job of a cluster relies on.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <map>
#include <random>
#include <thread>

#include "cli_process.h"
#include "cli_runner.h"
#include "support/json/json.h"

namespace voxelpipe {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::CliOutcome;
using testing::CliProcess;
using ::testing::HasSubstr;
using testing::LineCount;
using testing::ParseJson;
using testing::ReadFile;
using testing::RunCli;
using testing::TemporaryDirectory;
using testing::WriteBoxGlb;

using Tree = std::map<std::string, std::vector<uint8_t>>;

// Every file below a directory, hidden ones too.
Tree FilesBelow(const std::string& directory) {
  Tree files;
  if (!fs::exists(directory)) return files;
  for (const auto& entry : fs::recursive_directory_iterator(directory)) {
    if (entry.is_symlink()) files[entry.path().lexically_relative(directory).string()];  // a claim that was left
    if (!entry.is_regular_file()) continue;
    files[entry.path().lexically_relative(directory).string()] = ReadFile(entry.path().string());
  }
  return files;
}

size_t FinishedItems(const std::string& directory) {
  size_t count = 0;
  std::error_code ignored;
  for (fs::directory_iterator at(directory + "/.voxelpipe", ignored), end; !ignored && at != end;
       at.increment(ignored)) {
    if (at->path().extension() == ".json") ++count;
  }
  return count;
}

class CliBatch : public ::testing::Test {
 protected:
  CliBatch() {
    WriteBoxGlb(directory_ / "a.glb", 1, 1, 1);
    WriteBoxGlb(directory_ / "b.glb", 3, 2, 1);
  }

  void WriteList(const std::vector<std::string>& lines) {
    std::ofstream list(list_, std::ios::trunc);
    for (const std::string& line : lines) list << line << '\n';
  }
  // Enough work for a process to be caught in the midst of it.
  void WriteLongList(int items) {
    std::vector<std::string> lines(static_cast<size_t>(items));
    for (int i = 0; i < items; ++i) {
      lines[size_t(i)] = ("{\"input\":\"" + std::string(i % 2 == 0 ? "a" : "b") + ".glb\",\"id\":\"m" +
                          std::to_string(i) + "\",\"resolution\":" + std::to_string(40 + i) +
                          ",\"target\":[\"f32x4:replace:shader=position\",\"bit:or\"]}");
    }
    WriteList(lines);
  }
  std::vector<std::string> Command(const std::string& output, std::vector<std::string> options = {}) {
    options.insert(options.begin(), {"batch", list_, "--output-dir", directory_ / output});
    return options;
  }
  CliOutcome Batch(const std::string& output, std::vector<std::string> options = {}) {
    return RunCli(Command(output, std::move(options)));
  }

  // True once so many items are finished; false if the process ends before.
  bool WaitForItems(CliProcess& process, const std::string& output, size_t items) {
    while (FinishedItems(directory_ / output) < items) {
      if (!process.IsRunning()) return false;
      std::this_thread::yield();
    }
    return true;
  }

  TemporaryDirectory directory_;
  const std::string list_ = directory_ / "list.jsonl";
};

TEST_F(CliBatch, GivesTheFilesOfSingleCalls) {
  WriteList({R"({"input":"a.glb","resolution":20})",
             R"({"input":"b.glb","id":"sub/b","format":"npz","result":"sparse"})",
             R"({"input":"b.glb","output":"n.npy","target":["bit:or","f32x3:replace:shader=geometric_normal"]})"});
  const CliOutcome outcome = Batch("out", {"--resolution", "30", "--json"});
  ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
  const json totals = ParseJson(outcome.out);
  EXPECT_EQ(totals["items"], 3);
  EXPECT_EQ(totals["done"], 3);
  fs::create_directories(directory_ / "one/sub");
  const auto voxelize = [&](std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), "voxelize");
    EXPECT_EQ(RunCli(arguments).exit_code, 0);
  };
  voxelize({directory_ / "a.glb", "--resolution", "20", "-o", directory_ / "one/a.npy"});
  voxelize({directory_ / "b.glb", "--resolution", "30", "--result", "sparse", "-o", directory_ / "one/sub/b.npz"});
  voxelize({directory_ / "b.glb", "--resolution", "30", "--target", "bit:or", "--target",
            "f32x3:replace:shader=geometric_normal", "-o", directory_ / "one/n.npy"});
  Tree batch = FilesBelow(directory_ / "out");
  std::erase_if(batch, [](const auto& file) { return file.first.starts_with(".voxelpipe/"); });
  EXPECT_EQ(batch.size(), 4u);
  EXPECT_TRUE(batch == FilesBelow(directory_ / "one"));
}

TEST_F(CliBatch, ADirectoryIsAnOutputLikeAFile) {
  WriteList({R"({"input":"a.glb","format":"zarr"})"});
  const auto done = [&](const char* status) {
    const CliOutcome outcome = Batch("out", {"--resolution", "8", "--json"});
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return ParseJson(outcome.out)[status] == 1;
  };
  fs::create_directories(directory_ / "out/a.zarr.part-123-0/0");  // of a run that was killed
  fs::create_directories(directory_ / "out/.voxelpipe");
  fs::create_symlink("a run that ended", directory_ / "out/.voxelpipe/a.zarr.claim");
  EXPECT_TRUE(done("done"));
  EXPECT_FALSE(fs::exists(directory_ / "out/a.zarr.part-123-0"));
  EXPECT_TRUE(done("skipped"));
  ASSERT_GT(fs::remove_all(directory_ / "out/a.zarr/0/0"), 0u);
  EXPECT_TRUE(done("done")) << "a chunk is missing";
  EXPECT_TRUE(fs::exists(directory_ / "out/a.zarr/0/0/0/0"));
}

TEST_F(CliBatch, FailedItemsAreToldAndTheOthersDone) {
  std::ofstream(directory_ / "bad.glb") << "glTF but not really";
  WriteList({R"({"input":"missing.glb"})", R"({"input":"a.glb"})", R"({"input":"bad.glb"})"});
  const CliOutcome outcome = Batch("out", {"--resolution", "8", "--report", directory_ / "r/report.json"});
  EXPECT_EQ(outcome.exit_code, 3);
  EXPECT_EQ(LineCount(outcome.err), 2u) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("list.jsonl:1: missing: "));
  EXPECT_THAT(outcome.err, HasSubstr("list.jsonl:3: bad: "));
  const json report = ParseJson(ReadFile(directory_ / "r/report.json"));
  EXPECT_EQ(report["totals"]["failed"], 2);
  EXPECT_EQ(report["items"][0]["error"]["code"], "NOT_FOUND");
  EXPECT_EQ(report["items"][1]["status"], "done");
  EXPECT_EQ(report["items"][2]["error"]["code"], "INVALID_ARGUMENT");
  // Mended, it is a matter of the rest only.
  WriteBoxGlb(directory_ / "missing.glb", 1, 2, 1);
  WriteBoxGlb(directory_ / "bad.glb", 1, 1, 2);
  const CliOutcome again = Batch("out", {"--resolution", "8", "--json"});
  EXPECT_EQ(again.exit_code, 0);
  EXPECT_EQ(ParseJson(again.out)["done"], 2);
  EXPECT_EQ(ParseJson(again.out)["skipped"], 1);
}

TEST_F(CliBatch, WrongListsAndOptionsExitWith2AndDoNothing) {
  const auto expect_2 = [&](const CliOutcome& outcome, const std::string& says) {
    EXPECT_EQ(outcome.exit_code, 2);
    EXPECT_EQ(LineCount(outcome.err), 1u) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(says));
    EXPECT_FALSE(fs::exists(directory_ / "out"));
  };
  WriteList({R"({"input":"a.glb"})", R"({"input":"sub/a.glb"})"});
  expect_2(Batch("out"), "list.jsonl:2: the output 'a.npy'");
  WriteList({R"({"input":"a.glb"})", "{"});
  expect_2(Batch("out"), "list.jsonl:2: no JSON");
  WriteList({R"({"input":"a.glb"})"});
  expect_2(RunCli({"batch", directory_ / "none.jsonl", "--output-dir", directory_ / "out"}), "none.jsonl");
  expect_2(RunCli({"batch", list_}), "--output-dir");
  expect_2(Batch("out", {"--shard", "3/2"}), "--shard");
  expect_2(Batch("out", {"--jobs", "0"}), "--jobs");
  expect_2(Batch("out", {"--retries", "-1"}), "--retries");
  expect_2(Batch("out", {"--format", "xyz"}), "--format");
  expect_2(Batch("out", {"--server", ""}), "--server");
  expect_2(Batch("out", {"--fill", "maybe"}), "--fill");
}

TEST_F(CliBatch, ShardsTogetherAreTheWhole) {
  WriteLongList(7);
  ASSERT_EQ(Batch("whole").exit_code, 0);
  size_t items = 0;
  for (const char* shard : {"0/3", "1/3", "2/3"}) {
    const CliOutcome outcome = Batch("shards", {"--shard", shard, "--json"});
    ASSERT_EQ(outcome.exit_code, 0) << outcome.err;
    items += ParseJson(outcome.out)["done"].get<size_t>();
  }
  EXPECT_EQ(items, 7u);
  EXPECT_TRUE(FilesBelow(directory_ / "whole") == FilesBelow(directory_ / "shards"));
}

TEST_F(CliBatch, KilledTenTimesAtRandomMomentsTheOutputsAreThoseOfAnUndisturbedRun) {
  constexpr int kItems = 60, kKills = 10;
  WriteLongList(kItems);
  ASSERT_EQ(Batch("undisturbed").exit_code, 0);
  std::mt19937 random(std::random_device{}());
  for (int kill = 0; kill < kKills; ++kill) {
    CliProcess process(Command("killed", {"--jobs", "3"}));
    // Somewhere between the first item of this run and one of the next few.
    ASSERT_TRUE(WaitForItems(process, "killed", size_t(kill * 4 + 1 + int(random() % 4)))) << process.Wait();
    std::this_thread::sleep_for(std::chrono::microseconds(random() % 4000));
    ASSERT_TRUE(process.IsRunning());
    process.Signal(SIGKILL);
    EXPECT_EQ(process.Wait(), -SIGKILL);
  }
  const size_t before = FinishedItems(directory_ / "killed");
  EXPECT_LT(before, size_t(kItems));
  const CliOutcome last = Batch("killed", {"--json"});
  ASSERT_EQ(last.exit_code, 0) << last.err;
  EXPECT_EQ(ParseJson(last.out)["skipped"], before);  // what was finished stayed finished
  const Tree killed = FilesBelow(directory_ / "killed"), undisturbed = FilesBelow(directory_ / "undisturbed");
  for (const auto& [name, bytes] : killed) EXPECT_TRUE(undisturbed.contains(name)) << name << " is left over";
  EXPECT_TRUE(killed == undisturbed);
}

TEST_F(CliBatch, AStoppedRunSaysWhatIsLeft) {
  WriteLongList(60);
  CliProcess process(Command("out", {"--report", directory_ / "report.json"}));
  ASSERT_TRUE(WaitForItems(process, "out", 2));
  process.Signal(SIGINT);
  EXPECT_EQ(process.Wait(), 130);
  const json report = ParseJson(ReadFile(directory_ / "report.json"));
  const int done = report["totals"]["done"], left = report["totals"]["left"];
  EXPECT_GE(done, 2);
  EXPECT_GE(left, 1);
  EXPECT_EQ(done + left, 60);
  EXPECT_EQ(report["totals"]["failed"], 0);
  for (const auto& [name, bytes] : FilesBelow(directory_ / "out")) {
    EXPECT_EQ(name.find(".part-"), std::string::npos) << name;
    EXPECT_EQ(name.find(".voxelpipe/.voxelpipe"), std::string::npos) << name;
  }
  const CliOutcome again = Batch("out", {"--json"});
  EXPECT_EQ(again.exit_code, 0);
  EXPECT_EQ(ParseJson(again.out)["done"], left);
}

TEST_F(CliBatch, RunsAtTheSameTimeShareTheWorkWhateverTheirShards) {
  constexpr int kItems = 40;
  WriteLongList(kItems);
  ASSERT_EQ(Batch("whole").exit_code, 0);
  std::vector<std::string> reports;
  std::vector<std::unique_ptr<CliProcess>> runs;
  for (const char* shard : {"0/1", "0/2", "1/2", "0/3", "1/3", "2/3"}) {
    reports.push_back(directory_ / ("report" + std::to_string(reports.size()) + ".json"));
    runs.push_back(
        std::make_unique<CliProcess>(Command("out", {"--shard", shard, "--jobs", "2", "--report", reports.back()})));
  }
  for (const auto& run : runs) EXPECT_EQ(run->Wait(), 0);
  std::map<std::string, int> times_done;
  for (const std::string& path : reports) {
    const json report = ParseJson(ReadFile(path));
    for (const json& item : report["items"]) {
      if (item["status"] == "done") ++times_done[item["id"]];
    }
  }
  EXPECT_EQ(times_done.size(), size_t(kItems));
  for (const auto& [id, times] : times_done) EXPECT_EQ(times, 1) << id;
  EXPECT_TRUE(FilesBelow(directory_ / "whole") == FilesBelow(directory_ / "out"));
}

TEST_F(CliBatch, TheShardOfAnArrayJobIsThatOfItsEnvironment) {
  WriteLongList(5);
  const std::string slurm = "SLURM_ARRAY_TASK_ID=2 SLURM_ARRAY_TASK_MIN=1 SLURM_ARRAY_TASK_COUNT=3";
  const auto items = [&](const std::string& variables) {
    const CliOutcome outcome = RunCli(Command("out", {"--shard", "auto", "--json"}), "export " + variables + ";");
    EXPECT_EQ(outcome.exit_code, 0) << outcome.err;
    return outcome.exit_code == 0 ? int(ParseJson(outcome.out)["items"]) : -1;
  };
  EXPECT_EQ(items(slurm), 2);                                        // m1, m4
  EXPECT_EQ(items("JOB_COMPLETION_INDEX=4 VOXELPIPE_SHARDS=5"), 1);  // m4
  const CliOutcome missing = RunCli(Command("out", {"--shard", "auto"}), "export JOB_COMPLETION_INDEX=0;");
  EXPECT_EQ(missing.exit_code, 2);
  EXPECT_THAT(missing.err, HasSubstr("VOXELPIPE_SHARDS is not"));
}

TEST_F(CliBatch, AnEmptyListIsDone) {
  WriteList({});
  EXPECT_EQ(Batch("out").exit_code, 0);
}

TEST_F(CliBatch, NothingIsWrittenThroughALinkOutOfItsDirectory) {
  fs::create_directories(directory_ / "out");
  fs::create_directories(directory_ / "elsewhere");
  std::ofstream(directory_ / "elsewhere/file.npy") << "theirs";
  fs::create_directory_symlink(directory_ / "elsewhere", directory_ / "out/sub");
  fs::create_symlink(directory_ / "elsewhere/file.npy", directory_ / "out/file.npy");
  fs::create_symlink(directory_ / "elsewhere/new.npy", directory_ / "out/new.npy");
  fs::create_symlink("real.npy", directory_ / "out/inside.npy");
  WriteList({R"({"input":"a.glb","id":"sub/x"})", R"({"input":"a.glb","id":"sub/deeper/x"})",
             R"({"input":"a.glb","id":"file"})", R"({"input":"a.glb","id":"new"})",
             R"({"input":"a.glb","id":"inside"})", R"({"input":"a.glb","id":"y","preview":"sub/y.png"})"});
  const CliOutcome outcome = Batch("out", {"--resolution", "8", "--report", directory_ / "report.json"});
  EXPECT_EQ(outcome.exit_code, 3) << outcome.err;
  EXPECT_EQ(LineCount(outcome.err), 5u) << outcome.err;
  const json report = ParseJson(ReadFile(directory_ / "report.json"));
  for (const json& item : report["items"]) {
    if (item["id"] == "inside") {
      EXPECT_EQ(item["status"], "done");
      continue;
    }
    EXPECT_EQ(item["error"]["code"], "PERMISSION_DENIED") << item;
    EXPECT_THAT(std::string(item["error"]["message"]), HasSubstr("is a link that leads out of")) << item;
  }
  EXPECT_EQ(FilesBelow(directory_ / "elsewhere").size(), 1u);
  EXPECT_EQ(ReadFile(directory_ / "elsewhere/file.npy").size(), 6u);
  EXPECT_TRUE(fs::is_symlink(directory_ / "out/inside.npy"));
  EXPECT_TRUE(fs::is_regular_file(directory_ / "out/real.npy"));
}

TEST_F(CliBatch, TheOutputDirectoryItselfMayBeALink) {
  fs::create_directories(directory_ / "real");
  fs::create_directory_symlink("real", directory_ / "out");
  WriteList({R"({"input":"a.glb","id":"x"})"});
  EXPECT_EQ(Batch("out", {"--resolution", "8"}).exit_code, 0);
  EXPECT_TRUE(fs::exists(directory_ / "real/x.npy"));
}

TEST_F(CliBatch, OnlyPermanentErrorsOfItemsExitWith3) {
  std::ofstream(directory_ / "bad.glb") << "glTF but not really";
  WriteList({R"({"input":"a.glb","id":"good"})", R"({"input":"bad.glb"})", R"({"input":"missing.glb"})"});
  const CliOutcome outcome = Batch("out", {"--resolution", "8", "--report", directory_ / "report.json"});
  EXPECT_EQ(outcome.exit_code, 3) << outcome.err;
  const size_t at = outcome.err.find(directory_ / "missing.glb");  // named once
  ASSERT_NE(at, std::string::npos) << outcome.err;
  EXPECT_EQ(outcome.err.find(directory_ / "missing.glb", at + 1), std::string::npos) << outcome.err;
  const json report = ParseJson(ReadFile(directory_ / "report.json"));
  EXPECT_EQ(report["items"][1]["error"]["permanent"], true);
  // A full disk is not a fault of an item.
  WriteList({R"({"input":"bad.glb"})", R"({"input":"a.glb","id":"x"})"});
  EXPECT_EQ(RunCli(Command("small", {"--resolution", "128"}), "ulimit -f 8;").exit_code, 1);
}

TEST_F(CliBatch, ANameOfTheLongestLengthIsDoneOnce) {
  const std::string id(251, 'n');
  WriteList({"{\"input\":\"a.glb\",\"id\":\"" + id + "\"}"});
  EXPECT_EQ(Batch("out", {"--resolution", "8"}).exit_code, 0);
  EXPECT_TRUE(fs::exists(directory_ / ("out/" + id + ".npy")));
  EXPECT_EQ(ParseJson(Batch("out", {"--resolution", "8", "--json"}).out)["skipped"], 1);
}

TEST_F(CliBatch, ARawItemIsDescribedAndItsDescriptionBelongsToIt) {
  WriteList({R"({"input":"a.glb","id":"x","format":"raw"})"});
  ASSERT_EQ(Batch("out", {"--resolution", "8"}).exit_code, 0);
  EXPECT_TRUE(fs::exists(directory_ / "out/x.raw.json"));
  EXPECT_EQ(ParseJson(Batch("out", {"--resolution", "8", "--json"}).out)["skipped"], 1);
  fs::remove(directory_ / "out/x.raw.json");
  EXPECT_EQ(ParseJson(Batch("out", {"--resolution", "8", "--json"}).out)["done"], 1);
}

}  // namespace
}  // namespace voxelpipe
