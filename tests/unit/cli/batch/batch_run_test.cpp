// A batch over scripted engines.
#include "batch/batch_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <fstream>
#include <map>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "absl/strings/str_cat.h"
#include "batch/batch_report.h"
#include "batch/claim.h"
#include "batch/manifest.h"
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
    plan_.manifest = directory_ / "list.jsonl";
    plan_.output_dir = directory_ / "out";
  }
  std::vector<BatchItem> ItemsOfList() {
    absl::StatusOr<ManifestReader> list = ManifestReader::Open(plan_.manifest, defaults_);
    std::vector<BatchItem> items;
    while (std::optional<BatchItem> item = *list->Next()) items.push_back(*std::move(item));
    return items;
  }
  // What a run did: its result, and its items in the order of the list, with those that it did not come to.
  struct Outcome : BatchResult {
    std::vector<ItemReport> items;
  };
  Outcome Run() {
    absl::StatusOr<ManifestReader> list = ManifestReader::Open(plan_.manifest, defaults_);
    std::vector<ItemReport> items(list->Scan()->items);
    BatchHooks hooks = Hooks();
    hooks.next_item = [&] { return list->Next(); };
    hooks.on_ended = [&](const BatchItem& item, const ItemReport& report) {
      if (report.status == ItemStatus::kFailed) failures_.push_back(item.id);
      if (on_ended_) on_ended_(item, report);
      items[item.number] = report;
    };
    absl::StatusOr<BatchResult> result = RunBatch(plan_, hooks);
    EXPECT_TRUE(result.ok()) << result.status();
    return {*std::move(result), std::move(items)};
  }
  // Without a list.
  BatchHooks Hooks() {
    BatchHooks hooks;
    hooks.make_engine = [this](const std::string& server) { return std::make_unique<ScriptedEngine>(server, script_); };
    hooks.stop_signal = [this] { return signal_.load(); };
    hooks.retry_delay = [](const absl::Status& status) -> std::optional<std::chrono::milliseconds> {
      if (!absl::IsResourceExhausted(status) || status.message() != "busy") return std::nullopt;
      return std::chrono::milliseconds(1);
    };
    hooks.could_not_connect = [](const absl::Status& status) { return status.message() == "cannot connect"; };
    hooks.on_gone = [this](const absl::Status&) { ++gone_; };
    return hooks;
  }
  // The report of one more run.
  nlohmann::ordered_json ReportOf(const BatchPlan& plan) {
    absl::StatusOr<ReportWriter> report = ReportWriter::Create(directory_ / "report.json", plan);
    on_ended_ = [&](const BatchItem& item, const ItemReport& ended) { report->Add(item, ended); };
    const Outcome outcome = Run();
    on_ended_ = nullptr;
    EXPECT_TRUE(report->Finish(outcome, *ScanManifest(plan.manifest)).ok());
    const std::vector<uint8_t> text = ReadFile(directory_ / "report.json");
    return nlohmann::ordered_json::parse(text);
  }
  std::vector<ItemStatus> Statuses(const Outcome& result) {
    std::vector<ItemStatus> statuses;
    for (const ItemReport& item : result.items) statuses.push_back(item.status);
    return statuses;
  }

  TemporaryDirectory directory_;
  BatchPlan plan_;
  const ManifestDefaults defaults_;
  std::function<void(const BatchItem&, const ItemReport&)> on_ended_;
  Script script_;
  std::atomic<int> signal_{0};
  std::vector<std::string> failures_;
  int gone_ = 0;
};

TEST_F(BatchRunTest, WhatIsDoneIsNotDoneAgain) {
  Items(3);
  plan_.jobs = 2;
  EXPECT_THAT(Statuses(Run()), Each(ItemStatus::kDone));
  const Outcome again = Run();
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
  const Outcome result = Run();
  EXPECT_THAT(Statuses(result),
              ElementsAre(ItemStatus::kDone, ItemStatus::kFailed, ItemStatus::kDone, ItemStatus::kDone));
  EXPECT_EQ(result.items[1].error.message(), "no mesh");
  EXPECT_THAT(failures_, ElementsAre("1"));
  EXPECT_FALSE(std::filesystem::exists(directory_ / "out/1.npy"));
  const BatchTotals& totals = result.totals;
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
  const Outcome result = Run();
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
  const Outcome result = Run();
  EXPECT_THAT(Statuses(result), ElementsAre(ItemStatus::kDone));
  EXPECT_EQ(result.items[0].attempts, 5);
}

TEST_F(BatchRunTest, PatienceWithBusyServersEnds) {
  Items(1);
  plan_.servers = {"a"};
  plan_.busy_timeout = std::chrono::seconds(0);
  script_.before = [](const std::string&, JobContext&) { return absl::ResourceExhaustedError("busy"); };
  const Outcome result = Run();
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
  const nlohmann::ordered_json json = ReportOf(plan_);
  EXPECT_EQ(json["totals"]["done"], 1);
  EXPECT_EQ(json["items"][0]["status"], "done");
  EXPECT_EQ(json["items"][0]["files"], nlohmann::ordered_json({"0.npy"}));
  EXPECT_EQ(json["items"][1]["status"], "failed");
  const nlohmann::ordered_json error{{"code", "NOT_FOUND"}, {"message", "hm"}, {"permanent", true}};
  EXPECT_EQ(json["items"][1]["error"], error);
  EXPECT_EQ(json["items"][1]["line"], 2);
}

TEST_F(BatchRunTest, RunsAtTheSameTimeShareTheWork) {
  Items(40);
  plan_.jobs = 2;
  std::vector<Outcome> outcomes(3);
  std::vector<std::thread> threads;
  for (Outcome& outcome : outcomes) threads.emplace_back([&] { outcome = Run(); });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(script_.calls, 40) << "no item twice";
  size_t done = 0;
  for (const Outcome& outcome : outcomes) {
    done += outcome.totals.done;
    EXPECT_EQ(outcome.totals.done + outcome.totals.skipped, 40u);
    EXPECT_EQ(outcome.totals.left, 0u);
  }
  EXPECT_EQ(done, 40u);
}

TEST_F(BatchRunTest, AnItemOfAnotherRunIsWaitedForAndTakenOverIfThatFails) {
  Items(3);
  const BatchItem item = ItemsOfList()[0];
  const absl::StatusOr<RunPresence> other = RunPresence::Begin(plan_.output_dir);
  absl::StatusOr<std::optional<Claim>> claim = Claim::Take(plan_.output_dir, item, *other);
  std::vector<std::string> order;
  on_ended_ = [&](const BatchItem& ended, const ItemReport&) {
    order.push_back(ended.id);
    if (order.size() == 2) claim->reset();  // the other run failed at it
  };
  EXPECT_THAT(Statuses(Run()), Each(ItemStatus::kDone));
  EXPECT_THAT(order, ElementsAre("1", "2", "0"));
}

TEST_F(BatchRunTest, AStopDoesNotWaitForAnItemOfAnotherRun) {
  Items(2);
  const BatchItem item = ItemsOfList()[0];
  const absl::StatusOr<RunPresence> other = RunPresence::Begin(plan_.output_dir);
  const absl::StatusOr<std::optional<Claim>> claim = Claim::Take(plan_.output_dir, item, *other);
  on_ended_ = [&](const BatchItem&, const ItemReport&) { signal_ = 15; };
  const Outcome result = Run();
  EXPECT_THAT(Statuses(result), ElementsAre(ItemStatus::kLeft, ItemStatus::kDone));
  EXPECT_EQ(result.totals.left, 1u);
}

// What an option names is part of what an item is: another grid in the same file is another request.
TEST_F(BatchRunTest, AnotherGridInTheFileOfAGridLikeIsDoneAgain) {
  const auto grid = [&](const char* dims) {
    std::ofstream(directory_ / "grid.json") << R"({"origin":[0,0,0],"voxel_size":[1,1,1],"dims":)" << dims << "}";
  };
  grid("[2,1,1]");
  Items(1, R"(,"grid_like":"grid.json")");
  EXPECT_THAT(Statuses(Run()), ElementsAre(ItemStatus::kDone));
  EXPECT_THAT(Statuses(Run()), ElementsAre(ItemStatus::kSkipped));
  grid("[1,2,1]");
  EXPECT_THAT(Statuses(Run()), ElementsAre(ItemStatus::kDone));
}

TEST_F(BatchRunTest, AnErrorInTheListEndsTheRunAfterTheItemsBeforeIt) {
  Items(3);
  std::vector<BatchItem> items = ItemsOfList();
  BatchHooks hooks = Hooks();
  hooks.next_item = [&, next = size_t{0}]() mutable -> absl::StatusOr<std::optional<BatchItem>> {
    if (next < 2) return items[next++];
    return absl::InvalidArgumentError("line 3 is wrong");
  };
  const absl::StatusOr<BatchResult> result = RunBatch(plan_, hooks);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->list.message(), "line 3 is wrong");
  EXPECT_EQ(result->totals.done, 2u);
}

TEST_F(BatchRunTest, AReportIsInTheOrderOfTheListWhicheverItemEndsFirst) {
  Items(30);
  plan_.jobs = 4;
  script_.before = [this](const std::string&, JobContext&) {
    if (script_.calls == 1) std::this_thread::sleep_for(std::chrono::milliseconds(30));
    return absl::OkStatus();
  };
  std::ofstream(directory_ / "report.json.part-1-1") << "of a run that was killed";
  const nlohmann::ordered_json json = ReportOf(plan_);
  ASSERT_EQ(json["items"].size(), 30u);
  for (size_t i = 0; i < 30; ++i) EXPECT_EQ(json["items"][i]["line"], i + 1);
  EXPECT_EQ(json["manifest_items"], 30);
  EXPECT_EQ(json["manifest_sha256"], ScanManifest(plan_.manifest)->sha256);
  EXPECT_FALSE(std::filesystem::exists(directory_ / "report.json.part-1-1"));
}

TEST_F(BatchRunTest, TheRunEndsAndSaysSoWhereNoServerCanBeReached) {
  Items(200);
  plan_.servers = {"a", "b"};
  plan_.jobs = 4;
  plan_.retries = 0;  // of items: none was ever tried
  plan_.lost_timeout = std::chrono::milliseconds(600);
  script_.before = [](const std::string&, JobContext&) { return absl::UnavailableError("cannot connect"); };
  const auto begin = std::chrono::steady_clock::now();
  const Outcome result = Run();
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
  const Outcome result = Run();
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
  const Outcome result = Run();
  EXPECT_TRUE(result.items[0].permanent);
  EXPECT_FALSE(result.items[1].permanent);
  EXPECT_FALSE(result.items[2].permanent);
  EXPECT_EQ(result.totals.failed, 3u);
  EXPECT_EQ(result.totals.permanent, 1u);
}

}  // namespace
}  // namespace voxelpipe::cli
