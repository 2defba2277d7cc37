#include "results/result_sharing.h"

#include <algorithm>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "gtest/gtest.h"
#include "results/result_sums.h"

namespace voxelpipe {
namespace {

// A job that notes what it hears.
class FakeJob final : public VoxelizeJob {
 public:
  FakeJob() : VoxelizeJob([this](std::string_view stage, double) { stages.emplace_back(stage); }) {}

  absl::Status Planned(const Plan& /*plan*/, bool /*may_wait*/) override {
    ++planned;
    return absl::OkStatus();
  }
  ResultSink* large_results() override { return nullptr; }
  void Done(absl::StatusOr<JobOutcome> outcome) override { done.push_back(outcome.status()); }
  void PlanShared(const Plan& plan) override { plans.push_back(plan); }
  void DoneShared(const std::shared_ptr<const JobOutcome>& outcome, const Plan& /*plan*/, bool was_cached) override {
    results.push_back(std::move(outcome));
    cached.push_back(was_cached);
  }

  std::vector<std::string> stages;
  std::vector<Plan> plans;
  std::vector<absl::Status> done;
  std::vector<std::shared_ptr<const JobOutcome>> results;
  std::vector<bool> cached;
  int planned = 0;
};

class ResultSharingTest : public ::testing::Test {
 protected:
  explicit ResultSharingTest(uint64_t cache_bytes = 0)
      : sharing(scheduler, working, metrics, {.share = true, .cache_bytes = cache_bytes}) {
    scheduler.SetDevice({.device = "cpu", .kind = BackendChoice::kCpu}, 1);
  }

  static std::shared_ptr<KeptMesh> Mesh(char digit) {
    LoadedMesh loaded;
    loaded.mesh.positions = {{0, 0, 0}};
    return *KeptMesh::Make({}, "meshes/" + std::string(64, digit), MeshFormat::kGlb, 1, std::move(loaded));
  }

  std::shared_ptr<FakeJob> Job(int64_t resolution = 8) {
    auto job = std::make_shared<FakeJob>();
    job->config.request.grid.resolution = resolution;
    job->kept = {mesh};
    job->config.mesh_name = mesh->name();
    job->traits.client = "client";
    return job;
  }
  std::shared_ptr<FakeJob> Submitted(int64_t resolution = 8) {
    auto job = Job(resolution);
    EXPECT_TRUE(sharing.Submit(job).ok());
    return job;
  }

  void TearDown() override {
    while (scheduler.queued() > 0) {
      Take();
      End(absl::CancelledError("the test is over"));
    }
    scheduler.Drain();
    scheduler.Stop();
  }

  // The next run as a worker gets it.
  VoxelizeJob& Take() {
    taken = scheduler.TryTakeBatch({.device = "cpu", .kind = BackendChoice::kCpu});
    if (taken.size() != 1) throw std::logic_error("nothing to take");
    return static_cast<VoxelizeJob&>(*taken[0]);
  }
  // Ends what Take gave.
  void End(absl::StatusOr<JobOutcome> outcome) {
    static_cast<VoxelizeJob&>(*taken[0]).Done(std::move(outcome));
    scheduler.Ended(*taken[0]);
    taken.clear();
  }
  static JobOutcome Outcome(int64_t side = 8) {
    JobOutcome outcome;
    outcome.result.grid.dims = {side, side, side};
    outcome.result.stats.occupied = 42;
    return outcome;
  }
  static Plan OneSlab(uint64_t peak_bytes) {
    Plan plan;
    plan.grid.dims = {8, 8, 8};
    plan.slab_depth = 8;
    plan.peak_bytes = peak_bytes;
    return plan;
  }

  const std::shared_ptr<KeptMesh> mesh = Mesh('a');
  Metrics metrics;
  ByteBudget working{1000};
  Scheduler scheduler{{.max_queue = 4, .timer_thread = false}, 1};
  ResultSharing sharing;
  std::vector<std::shared_ptr<Task>> taken;
};

class ResultCacheTest : public ResultSharingTest {
 protected:
  ResultCacheTest() : ResultSharingTest(20'000) {}
};

TEST_F(ResultSharingTest, EqualJobsRunOnce) {
  const auto a = Submitted(), b = Submitted(), c = Submitted();
  EXPECT_EQ(scheduler.queued(), 1u);
  VoxelizeJob& run = Take();
  run.context.Report("load", 0);
  EXPECT_TRUE(run.Planned(OneSlab(100), true).ok());
  End(Outcome());
  for (const auto& job : {a, b, c}) {
    ASSERT_EQ(job->results.size(), 1u);
    EXPECT_EQ(job->results[0], a->results[0]) << "one object for all";
    EXPECT_EQ(job->plans.size(), 1u);
    EXPECT_EQ(job->stages, std::vector<std::string>{"load"});
    EXPECT_EQ(job->planned, 0) << "the run holds the memory";
    EXPECT_TRUE(job->done.empty());
  }
  EXPECT_EQ(metrics.jobs_shared.Value(), 2);
  EXPECT_EQ(a->cached, std::vector<bool>{false});
  EXPECT_EQ(b->cached, std::vector<bool>{true});
  ASSERT_TRUE(a->results[0]->sums);
  EXPECT_FALSE(a->results[0]->sums->sha256().empty()) << "hashed once";
}

TEST_F(ResultSharingTest, OtherRequestsRunApart) {
  const auto a = Submitted(8), b = Submitted(9);
  const auto other_mesh = Job(8);
  other_mesh->kept = {Mesh('b')};
  ASSERT_TRUE(sharing.Submit(other_mesh).ok());
  EXPECT_EQ(scheduler.queued(), 3u);
  for (int i = 0; i < 3; ++i) {
    Take();
    End(Outcome());
  }
  EXPECT_NE(a->results.at(0), b->results.at(0));
  EXPECT_FALSE(a->results.at(0)->sums) << "hashed while it is sent";
}

// A name must not be taken for a part of the next one, nor an entry for two.
TEST_F(ResultSharingTest, ListsOfPlacedMeshesHaveKeysOfTheirOwn) {
  const auto key = [this](const std::vector<PlacedStored>& list) {
    const auto job = Job();
    job->config.placed = std::make_shared<const std::vector<PlacedStored>>(list);
    return RequestKey(*job);
  };
  const std::string id = mesh->name();
  std::set<std::string> keys{RequestKey(*Job())};
  const std::vector<std::vector<PlacedStored>> lists{{{id}},
                                                     {{id}, {id}},
                                                     {{id, Mat4d(), "ab"}, {id, Mat4d(), "c"}},
                                                     {{id, Mat4d(), "a"}, {id, Mat4d(), "bc"}},
                                                     {{id, Mat4d(), "", 1u}},
                                                     {{id, Mat4d(), "", {}, 1}},
                                                     {{id, Mat4d(), "", {}, 0, RigidMotionNumbers()}}};
  for (size_t i = 0; i < lists.size(); ++i) {
    EXPECT_TRUE(keys.insert(key(lists[i])).second) << i;
    EXPECT_EQ(key(lists[i]), key(lists[i])) << i;
  }
}

TEST_F(ResultSharingTest, WhatCannotBeSharedGoesThrough) {
  const auto file = Job(), moved = Job(), timed = Job();
  file->kept.clear();
  moved->config.new_positions = true;
  timed->config.settings.queue_timeout = std::chrono::milliseconds(5);
  for (const auto& job : {file, moved, timed}) {
    EXPECT_TRUE(RequestKey(*job).empty());
    ASSERT_TRUE(sharing.Submit(job).ok());
    EXPECT_EQ(&Take(), job.get());
    End(absl::InternalError("x"));
    EXPECT_EQ(job->done.size(), 1u);
  }
}

TEST_F(ResultSharingTest, WhatDoesNotChangeTheBytesDoesNotTellJobsApart) {
  const auto a = Job(), b = Job(), c = Job();
  b->config.settings.compression = Compression::kZstd;
  b->config.settings.content_hash = false;
  b->config.request.threads = 7;
  c->config.request.fill = Fill::kParity;
  EXPECT_EQ(RequestKey(*a), RequestKey(*b));
  EXPECT_NE(RequestKey(*a), RequestKey(*c));
}

TEST_F(ResultSharingTest, WhatTargetsAreFilledAndEncodedWithTellsJobsApart) {
  std::vector<std::string> keys;
  for (int i = 0; i < 7; ++i) {
    const auto job = Job();
    VoxelizeRequest& request = job->config.request;
    request.fill = i == 1 ? Fill::kNonzero : Fill::kParity;
    if (i == 2) request.coverage = Coverage::kNone;
    if (i == 3) request.targets[0].fill_values = {1};
    if (i == 4) request.targets[0].fill_values = {1, 1};
    if (i == 5) request.targets[0].encoding = Encoding::kSrgb;
    if (i == 6) request.targets[0].fill_values = {0};
    const std::string key = RequestKey(*job);
    EXPECT_EQ(std::count(keys.begin(), keys.end(), key), 0) << i;
    keys.push_back(key);
  }
}

TEST_F(ResultSharingTest, WhoWithdrawsDoesNotDisturbTheOthers) {
  const auto a = Submitted(), b = Submitted();
  EXPECT_TRUE(sharing.Withdraw(*a)) << "the one that started it";
  EXPECT_FALSE(sharing.Withdraw(*a)) << "once";
  VoxelizeJob& run = Take();
  EXPECT_TRUE(run.context.Check().ok());
  End(Outcome());
  EXPECT_TRUE(a->results.empty() && a->done.empty());
  EXPECT_EQ(b->results.size(), 1u);
}

TEST_F(ResultSharingTest, WithoutAnybodyTheRunStops) {
  const auto a = Submitted(), b = Submitted();
  EXPECT_TRUE(sharing.Withdraw(*a));
  EXPECT_TRUE(sharing.Withdraw(*b));
  EXPECT_EQ(scheduler.queued(), 0u) << "it had not begun";

  const auto c = Submitted();
  VoxelizeJob& run = Take();
  EXPECT_TRUE(sharing.Withdraw(*c));
  EXPECT_TRUE(absl::IsCancelled(run.context.Check()));
  const auto d = Submitted();
  EXPECT_EQ(scheduler.queued(), 1u) << "what is being stopped is not joined";
  End(absl::CancelledError("stopped"));
  Take();
  End(Outcome());
  EXPECT_TRUE(c->results.empty() && c->done.empty());
  EXPECT_EQ(d->results.size(), 1u);
}

TEST_F(ResultSharingTest, AnErrorOfTheRequestGoesToAll) {
  const auto a = Submitted(), b = Submitted();
  Take();
  End(absl::InvalidArgumentError("broken"));
  EXPECT_TRUE(absl::IsInvalidArgument(a->done.at(0)));
  EXPECT_TRUE(absl::IsInvalidArgument(b->done.at(0)));
}

TEST_F(ResultSharingTest, AnErrorOfTheRunLetsEachTryAlone) {
  const auto a = Submitted(), b = Submitted();
  Take();
  End(absl::DeadlineExceededError("the first one's"));
  EXPECT_TRUE(a->done.empty() && b->done.empty());
  EXPECT_EQ(scheduler.queued(), 2u);
  Take();
  End(absl::InternalError("a"));
  Take();
  End(absl::InternalError("b"));
  EXPECT_EQ(a->done.size() + b->done.size(), 2u);
}

TEST_F(ResultSharingTest, AResultOfSeveralSlabsIsMadeByEachAlone) {
  const auto a = Submitted();
  VoxelizeJob& run = Take();
  Plan plan = OneSlab(10);
  plan.slab_depth = 4;
  const absl::Status refused = run.Planned(plan, true);
  EXPECT_TRUE(absl::IsAborted(refused));
  EXPECT_TRUE(absl::IsAborted(run.large_results()->Begin({})));
  EXPECT_TRUE(a->plans.empty());
  End(refused);
  EXPECT_EQ(&Take(), a.get());
  End(absl::InternalError("x"));
  EXPECT_EQ(working.used(), 0u);
}

TEST_F(ResultSharingTest, AFullQueueRefusesWhoCame) {
  for (int i = 0; i < 8; ++i) {
    const auto job = Job(i + 1);
    const absl::Status status = sharing.Submit(job);
    if (status.ok()) continue;
    EXPECT_TRUE(absl::IsResourceExhausted(status)) << status;
    EXPECT_TRUE(job->done.empty()) << "the caller ends it";
    EXPECT_FALSE(sharing.Withdraw(*job));
    return;
  }
  FAIL() << "the queue takes all";
}

// Of the waiters of one run, the one with the best place determines the time of all.
TEST_F(ResultSharingTest, AnEqualJobGetsTheBestPlaceOfAllWhoWait) {
  for (int i = 0; i < 3; ++i) Submitted(100 + i);
  const auto a = Submitted(8), b = Job(8);
  b->traits.client = "another";
  ASSERT_TRUE(sharing.Submit(b).ok());
  EXPECT_EQ(scheduler.queued(), 4u);
  Take();  // of either client
  End(Outcome());
  if (a->results.empty()) {
    Take();
    End(Outcome());
  }
  EXPECT_EQ(a->results.size(), 1u) << "the other client had nothing before it";
  EXPECT_EQ(b->results.size(), 1u);
}

TEST_F(ResultSharingTest, AnEqualJobGetsTheBestPriorityOfAllWhoWait) {
  for (int i = 0; i < 3; ++i) Submitted(100 + i);
  const auto low = Job(8), high = Job(8);
  low->config.settings.priority = low->traits.priority = Priority::kLow;
  high->config.settings.priority = high->traits.priority = Priority::kHigh;
  ASSERT_TRUE(sharing.Submit(low).ok());
  ASSERT_TRUE(sharing.Submit(high).ok());
  EXPECT_EQ(scheduler.queued(), 4u) << "priorities do not tell jobs apart";
  Take();
  End(Outcome());
  EXPECT_EQ(low->results.size(), 1u);
  EXPECT_EQ(high->results.size(), 1u);
}

TEST_F(ResultSharingTest, APlaceGoesWithWhoHadIt) {
  for (int i = 0; i < 3; ++i) Submitted(100 + i);
  const auto low = Job(8), high = Job(8);
  low->traits.priority = Priority::kLow;
  high->traits.priority = Priority::kHigh;
  ASSERT_TRUE(sharing.Submit(low).ok());
  ASSERT_TRUE(sharing.Submit(high).ok());
  EXPECT_TRUE(sharing.Withdraw(*high));
  EXPECT_EQ(scheduler.state().jobs[size_t(Priority::kHigh)], 0u);
  EXPECT_EQ(scheduler.state().jobs[size_t(Priority::kLow)], 1u);
  Take();
  End(Outcome());
  EXPECT_TRUE(low->results.empty());
}

TEST_F(ResultSharingTest, TheLatestDeadlineOfAllWhoWaitCounts) {
  const auto a = Job(8), b = Job(8);
  a->traits.deadline = JobContext::Clock::now() + std::chrono::milliseconds(30);
  ASSERT_TRUE(sharing.Submit(a).ok());
  ASSERT_TRUE(sharing.Submit(b).ok()) << "without a deadline";
  std::this_thread::sleep_for(std::chrono::milliseconds(40));
  scheduler.RunTimers();
  EXPECT_EQ(scheduler.queued(), 1u) << "somebody still waits";
  Take();
  End(Outcome());
  EXPECT_EQ(b->results.size(), 1u);

  const auto c = Job(9);
  c->traits.deadline = JobContext::Clock::now() + std::chrono::milliseconds(10);
  ASSERT_TRUE(sharing.Submit(c).ok());
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
  scheduler.RunTimers();
  ASSERT_EQ(c->done.size(), 1u) << "nobody waits any more, and it is not tried again";
  EXPECT_TRUE(absl::IsDeadlineExceeded(c->done[0]));
}

TEST_F(ResultSharingTest, TheMemoryIsHeldWhileSomebodyReads) {
  const auto a = Submitted(), b = Submitted();
  VoxelizeJob& run = Take();
  EXPECT_TRUE(run.Planned(OneSlab(600), true).ok());
  EXPECT_EQ(working.used(), 600u);
  JobOutcome outcome = Outcome();
  outcome.result.targets.emplace_back();
  outcome.result.targets.back() = *HostBuffer::Allocate(64);
  End(std::move(outcome));
  EXPECT_EQ(working.used(), 64u) << "what the pipeline worked in is given back";
  a->results.clear();
  EXPECT_EQ(working.used(), 64u);
  b->results.clear();
  EXPECT_EQ(working.used(), 0u);
}

TEST_F(ResultCacheTest, AKeptResultAnswersLaterJobsAtOnce) {
  const auto a = Submitted();
  Take();
  End(Outcome());
  const auto b = Submitted();
  EXPECT_EQ(scheduler.queued(), 0u);
  ASSERT_EQ(b->results.size(), 1u);
  EXPECT_EQ(b->results[0].get(), a->results.at(0).get());
  EXPECT_EQ(b->cached, std::vector<bool>{true});
  a->results.clear();
  b->results.clear();
  EXPECT_EQ(working.used(), 0u) << "the cache has a bound of its own";
  EXPECT_EQ(sharing.cache().stats().entries, 1u);
}

TEST_F(ResultCacheTest, ErrorsAreNotKept) {
  Submitted();
  Take();
  End(absl::ResourceExhaustedError("no memory"));
  Submitted();
  EXPECT_EQ(scheduler.queued(), 1u);
  Take();
  End(Outcome());
}

TEST_F(ResultCacheTest, TheLongestUnusedResultGoes) {
  for (int64_t resolution = 1; resolution <= 6; ++resolution) {  // each takes at least 4 KiB
    Submitted(resolution);
    Take();
    End(Outcome());
  }
  EXPECT_LE(sharing.cache().stats().bytes, 20'000u);
  EXPECT_GT(sharing.cache().stats().evictions, 0u);
  Submitted(6);
  EXPECT_EQ(scheduler.queued(), 0u);
  Submitted(1);
  EXPECT_EQ(scheduler.queued(), 1u);
  Take();
  End(Outcome());
}

}  // namespace
}  // namespace voxelpipe
