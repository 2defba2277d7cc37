// A batch over scripted engines.
#include "batch/batch_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <fstream>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "batch/batch_report.h"
#include "batch/done_record.h"
#include "batch/leftovers.h"
#include "unit/cli/cli_runner.h"

namespace voxelpipe::cli {
namespace {

using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::Field;
using testing::ReadFile;
using testing::TemporaryDirectory;
using testing::WriteBoxGlb;

// What the engines of one test do: per call, by server.
struct Script {
  std::function<absl::Status(const std::string& server, JobContext& job)> before;
  std::atomic<int> calls{0};
  std::mutex mutex;
  std::map<std::string, int> calls_of;
};

// Gives a grid of 2 x 1 x 1 bits, one of them set.
class ScriptedEngine final : public Engine {
 public:
  ScriptedEngine(std::string server, Script& script) : server_(std::move(server)), script_(script) {}

  absl::StatusOr<EngineRun> Run(MeshInputs, const VoxelizeRequest& request, int, JobContext& job, ResultSink& sink,
                                VoxelizeResult*) override {
    ++script_.calls;
    {
      const std::lock_guard lock(script_.mutex);
      ++script_.calls_of[server_];
    }
    if (script_.before) {
      if (absl::Status s = script_.before(server_, job); !s.ok()) return s;
    }
    GridSpec grid;
    grid.dims = {2, 1, 1};
    const ResultHeader header = DenseHeader(request, grid);
    const uint8_t bits = 1;
    if (absl::Status s = sink.Begin(header); !s.ok()) return s;
    for (size_t i = 0; i < header.arrays.size(); ++i) {
      if (absl::Status s = sink.Write(i, {&bits, 1}); !s.ok()) return s;
    }
    EngineRun run;
    run.runs.emplace_back();
    return run;
  }
  absl::StatusOr<std::vector<ShaderInfo>> Shaders() override { return absl::UnimplementedError(""); }

 private:
  const std::string server_;
  Script& script_;
};

class BatchRunTest : public ::testing::Test {
 protected:
  // Items "0", "1", ... over one input, in two requests.
  void Items(int count, const std::string& more = "") {
    WriteBoxGlb(directory_ / "box.glb", 1, 1, 1);
    {
      std::ofstream list(directory_ / "list.jsonl");
      for (int i = 0; i < count; ++i) list << "{\"input\":\"box.glb\",\"id\":" << i << more << "}\n";
    }
    plan_.items = ReadManifest(directory_ / "list.jsonl", {})->items;
    plan_.output_dir = directory_ / "out";
  }
  BatchResult Run() {
    BatchHooks hooks;
    hooks.make_engine = [this](const std::string& server) { return std::make_unique<ScriptedEngine>(server, script_); };
    hooks.stop_signal = [this] { return signal_.load(); };
    hooks.retry_delay = [](const absl::Status& status) -> std::optional<std::chrono::milliseconds> {
      if (!absl::IsResourceExhausted(status) || status.message() != "busy") return std::nullopt;
      return std::chrono::milliseconds(1);
    };
    hooks.could_not_connect = [](const absl::Status& status) { return status.message() == "cannot connect"; };
    hooks.on_gone = [this](const absl::Status&) { ++gone_; };
    hooks.on_failure = [this](const BatchItem& item, const absl::Status&) { failures_.push_back(item.id); };
    return RunBatch(plan_, hooks);
  }
  std::vector<ItemStatus> Statuses(const BatchResult& result) {
    std::vector<ItemStatus> statuses;
    for (const ItemReport& item : result.items) statuses.push_back(item.status);
    return statuses;
  }

  TemporaryDirectory directory_;
  BatchPlan plan_;
  Script script_;
  std::atomic<int> signal_{0};
  std::vector<std::string> failures_;
  int gone_ = 0;
};

TEST_F(BatchRunTest, WhatIsDoneIsNotDoneAgain) {
  Items(3);
  plan_.jobs = 2;
  EXPECT_THAT(Statuses(Run()), Each(ItemStatus::kDone));
  const BatchResult again = Run();
  EXPECT_THAT(Statuses(again), Each(ItemStatus::kSkipped));
  EXPECT_EQ(script_.calls, 3);
  EXPECT_THAT(again.items[1].files, ElementsAre("1.npy"));
  EXPECT_EQ(again.items[1].bytes, 1u);
  EXPECT_EQ(again.items[1].hash.size(), 64u);
}

TEST_F(BatchRunTest, AChangedInputARequestOrALostFileIsDoneAgain) {
  Items(2);
  Run();
  std::filesystem::remove(directory_ / "out/1.npy");
  EXPECT_THAT(Statuses(Run()), ElementsAre(ItemStatus::kSkipped, ItemStatus::kDone));
  std::ofstream(directory_ / "out/0.npy", std::ios::app) << "x";  // not the size that was written
  EXPECT_THAT(Statuses(Run()), ElementsAre(ItemStatus::kDone, ItemStatus::kSkipped));
  Items(2, ",\"resolution\":9");
  EXPECT_THAT(Statuses(Run()), Each(ItemStatus::kDone));
  Items(2, ",\"resolution\":9,\"threads\":2,\"backend\":\"cpu\"");  // the same bytes
  EXPECT_THAT(Statuses(Run()), Each(ItemStatus::kSkipped));
  WriteBoxGlb(directory_ / "box.glb", 1, 1, 2);  // as long as before
  EXPECT_THAT(Statuses(Run()), Each(ItemStatus::kDone));
}

TEST_F(BatchRunTest, ARecordDoesNotOutliveItsFiles) {
  Items(1);
  Run();
  Items(1, ",\"resolution\":9");
  script_.before = [](const std::string&, JobContext&) { return absl::InternalError("broken"); };
  EXPECT_THAT(Statuses(Run()), ElementsAre(ItemStatus::kFailed));
  script_.before = nullptr;
  // The file of the first request still exists, but has no record any more.
  Items(1);
  EXPECT_THAT(Statuses(Run()), ElementsAre(ItemStatus::kDone));
}

TEST_F(BatchRunTest, AnItemsErrorIsItsOwn) {
  Items(4);
  std::atomic<int> number{0};
  script_.before = [&](const std::string&, JobContext&) {
    return number++ == 1 ? absl::InvalidArgumentError("no mesh") : absl::OkStatus();
  };
  const BatchResult result = Run();
  EXPECT_THAT(Statuses(result),
              ElementsAre(ItemStatus::kDone, ItemStatus::kFailed, ItemStatus::kDone, ItemStatus::kDone));
  EXPECT_EQ(result.items[1].error.message(), "no mesh");
  EXPECT_THAT(failures_, ElementsAre("1"));
  EXPECT_FALSE(std::filesystem::exists(directory_ / "out/1.npy"));
  const BatchTotals totals = TotalsOf(result);
  EXPECT_EQ(totals.done, 3u);
  EXPECT_EQ(totals.failed, 1u);
  EXPECT_EQ(totals.bytes, 3u);
}

TEST_F(BatchRunTest, FailFastLeavesTheRest) {
  Items(4);
  plan_.fail_fast = true;
  script_.before = [](const std::string&, JobContext&) { return absl::InternalError("broken"); };
  EXPECT_THAT(Statuses(Run()),
              ElementsAre(ItemStatus::kFailed, ItemStatus::kLeft, ItemStatus::kLeft, ItemStatus::kLeft));
}

TEST_F(BatchRunTest, AnExceptionIsTheItemsError) {
  Items(1);
  script_.before = [](const std::string&, JobContext&) -> absl::Status { throw std::bad_alloc(); };
  EXPECT_TRUE(absl::IsResourceExhausted(Run().items[0].error));
}

TEST_F(BatchRunTest, AStopCancelsWhatRunsAndLeavesTheRest) {
  Items(3);
  script_.before = [this](const std::string&, JobContext& job) {
    signal_ = 2;
    while (job.Check().ok()) std::this_thread::yield();
    return job.Check();
  };
  EXPECT_THAT(Statuses(Run()), Each(ItemStatus::kLeft));
  EXPECT_EQ(script_.calls, 1);
  EXPECT_THAT(failures_, ElementsAre());
}

TEST_F(BatchRunTest, ItemsOfALostServerGoToAnother) {
  Items(6);
  plan_.servers = {"a", "b"};
  script_.before = [](const std::string& server, JobContext&) {
    return server == "a" ? absl::UnavailableError("gone") : absl::OkStatus();
  };
  const BatchResult result = Run();
  EXPECT_THAT(Statuses(result), Each(ItemStatus::kDone));
  EXPECT_THAT(result.items, Each(Field(&ItemReport::server, "b")));
  EXPECT_EQ(script_.calls_of["b"], 6);
  EXPECT_LT(script_.calls_of["a"], 6);  // left alone while it rests
}

TEST_F(BatchRunTest, ABusyServerIsAskedUntilItAnswers) {
  Items(1);
  plan_.servers = {"a"};
  plan_.retries = 0;  // waiting is no failure
  script_.before = [this](const std::string&, JobContext&) {
    return script_.calls < 5 ? absl::ResourceExhaustedError("busy") : absl::OkStatus();
  };
  const BatchResult result = Run();
  EXPECT_THAT(Statuses(result), ElementsAre(ItemStatus::kDone));
  EXPECT_EQ(result.items[0].attempts, 5);
}

TEST_F(BatchRunTest, PatienceWithBusyServersEnds) {
  Items(1);
  plan_.servers = {"a"};
  plan_.busy_timeout = std::chrono::seconds(0);
  script_.before = [](const std::string&, JobContext&) { return absl::ResourceExhaustedError("busy"); };
  const BatchResult result = Run();
  EXPECT_THAT(Statuses(result), ElementsAre(ItemStatus::kFailed));
  EXPECT_EQ(script_.calls, 1);
}

TEST_F(BatchRunTest, RetriesAreCountedAndOnlyForWhatMayPass) {
  Items(1);
  plan_.servers = {"a", "b", "c"};  // so that no item waits for a suspension
  plan_.retries = 2;
  script_.before = [](const std::string&, JobContext&) { return absl::UnavailableError("gone"); };
  EXPECT_EQ(Run().items[0].attempts, 3);
  for (const absl::Status& final_one :
       {absl::InvalidArgumentError("x"), absl::ResourceExhaustedError("too large"), absl::InternalError("x")}) {
    script_.before = [&](const std::string&, JobContext&) { return final_one; };
    Items(1);
    EXPECT_EQ(Run().items[0].attempts, 1) << final_one;
  }
}

TEST_F(BatchRunTest, DoneItemsNeedNoServer) {
  Items(2);
  plan_.servers = {"a"};
  Run();
  script_.before = [](const std::string&, JobContext&) { return absl::UnavailableError("gone"); };
  EXPECT_THAT(Statuses(Run()), Each(ItemStatus::kSkipped));
}

TEST_F(BatchRunTest, AReportNamesEveryItem) {
  Items(2);
  std::atomic<int> number{0};
  script_.before = [&](const std::string&, JobContext&) {
    return number++ == 0 ? absl::OkStatus() : absl::NotFoundError("hm");
  };
  const nlohmann::ordered_json json = ReportJson(plan_, Run());
  EXPECT_EQ(json["totals"]["done"], 1);
  EXPECT_EQ(json["items"][0]["status"], "done");
  EXPECT_EQ(json["items"][0]["files"], nlohmann::ordered_json({"0.npy"}));
  EXPECT_EQ(json["items"][1]["status"], "failed");
  const nlohmann::ordered_json error{{"code", "NOT_FOUND"}, {"message", "hm"}, {"permanent", true}};
  EXPECT_EQ(json["items"][1]["error"], error);
  EXPECT_EQ(json["items"][1]["line"], 2);
}

TEST_F(BatchRunTest, LeftoversOfTheseItemsGoAndNoOthers) {
  Items(2, ",\"target\":[\"bit:or\",\"bit:and\"]");
  Run();
  const std::string out = directory_ / "out/";
  for (const char* name : {"0.0.npy.part-1-2", "1.1.npy.part-77-0", ".voxelpipe/0.npy.json.part-1-2"}) {
    std::ofstream(out + name) << "half";
  }
  for (const char* name : {"2.npy.part-1-2", "0.0.npy.part-", "0.0.npy.part-1-2.txt", "notes.part-1-1"}) {
    std::ofstream(out + name) << "someone's";
  }
  RemoveLeftovers(plan_.output_dir, plan_.items);
  std::vector<std::string> left;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(out)) {
    if (entry.is_regular_file()) left.push_back(entry.path().filename().string());
  }
  EXPECT_THAT(left, ::testing::UnorderedElementsAre("0.0.npy", "0.1.npy", "1.0.npy", "1.1.npy", "0.npy.json",
                                                    "1.npy.json", "2.npy.part-1-2", "0.0.npy.part-",
                                                    "0.0.npy.part-1-2.txt", "notes.part-1-1"));
}

TEST_F(BatchRunTest, OneRunAtATimeHasAShard) {
  const std::string out = directory_ / "out";
  {
    const absl::StatusOr<RunLock> first = RunLock::Take(out, {0, 2});
    ASSERT_TRUE(first.ok()) << first.status();
    EXPECT_TRUE(absl::IsAborted(RunLock::Take(out, {2, 2}).status()));
    EXPECT_TRUE(RunLock::Take(out, {1, 2}).ok());
  }
  EXPECT_TRUE(RunLock::Take(out, {0, 2}).ok());
  EXPECT_TRUE(std::filesystem::is_empty(out + "/.voxelpipe"));
}

// Who may write to the directory could make a run create, or open, a file anywhere.
TEST_F(BatchRunTest, ALinkOrAFifoInThePlaceOfTheLockIsRefusedByNameAndNotFollowed) {
  namespace fs = std::filesystem;
  const std::string out = directory_ / "out";
  const fs::path lock = fs::path(out) / ".voxelpipe" / "lock-0-of-1", outside = directory_ / "outside";
  fs::create_directories(lock.parent_path());
  for (const bool dangling : {true, false}) {
    if (!dangling) std::ofstream(outside) << "someone's";
    fs::create_symlink(outside, lock);
    const absl::Status status = RunLock::Take(out, {0, 1}).status();
    EXPECT_TRUE(absl::IsPermissionDenied(status)) << status;
    EXPECT_THAT(std::string(status.message()), ::testing::HasSubstr("'" + lock.string() + "' is a link"));
    EXPECT_EQ(fs::exists(outside), !dangling);
    EXPECT_TRUE(fs::is_symlink(lock));
    fs::remove(lock);
  }
  ASSERT_EQ(mkfifo(lock.c_str(), 0600), 0);
  const absl::Status status = RunLock::Take(out, {0, 1}).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(status)) << status;
  EXPECT_THAT(std::string(status.message()), ::testing::HasSubstr("'" + lock.string() + "' is not a regular file"));
  EXPECT_TRUE(fs::is_fifo(lock));
}

TEST_F(BatchRunTest, TheRunEndsAndSaysSoWhereNoServerCanBeReached) {
  Items(200);
  plan_.servers = {"a", "b"};
  plan_.jobs = 4;
  plan_.retries = 0;  // of items: none was ever tried
  plan_.lost_timeout = std::chrono::milliseconds(600);
  script_.before = [](const std::string&, JobContext&) { return absl::UnavailableError("cannot connect"); };
  const auto begin = std::chrono::steady_clock::now();
  const BatchResult result = Run();
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(20));
  EXPECT_TRUE(absl::IsUnavailable(result.gone)) << result.gone;
  EXPECT_THAT(std::string(result.gone.message()), ::testing::HasSubstr("cannot connect"));
  EXPECT_THAT(Statuses(result), Each(ItemStatus::kLeft));
  EXPECT_EQ(gone_, 1);
  EXPECT_TRUE(failures_.empty());
}

TEST_F(BatchRunTest, AServerThatCannotBeReachedCostsNoItemAnAttemptAndIsWaitedFor) {
  Items(6);
  plan_.servers = {"a"};
  plan_.retries = 0;
  script_.before = [this](const std::string&, JobContext&) {
    return script_.calls < 3 ? absl::UnavailableError("cannot connect") : absl::OkStatus();
  };
  const BatchResult result = Run();
  EXPECT_TRUE(result.gone.ok());
  EXPECT_THAT(Statuses(result), Each(ItemStatus::kDone));
  EXPECT_EQ(gone_, 1);
}

TEST_F(BatchRunTest, ErrorsThatWouldComeAgainArePermanent) {
  Items(4);
  plan_.servers = {"a"};
  plan_.retries = 0;
  script_.before = [this](const std::string&, JobContext&) -> absl::Status {
    switch (script_.calls) {
      case 1: return absl::InvalidArgumentError("broken");
      case 2: return absl::UnavailableError("gone");
      case 3: return absl::PermissionDeniedError("not yours");
      default: return absl::OkStatus();
    }
  };
  const BatchResult result = Run();
  EXPECT_TRUE(result.items[0].permanent);
  EXPECT_FALSE(result.items[1].permanent);
  EXPECT_FALSE(result.items[2].permanent);
  EXPECT_EQ(TotalsOf(result).failed, 3u);
  EXPECT_EQ(TotalsOf(result).permanent, 1u);
}

}  // namespace
}  // namespace voxelpipe::cli
