// Devices that break under the pool's hands: every job gets the right answer, once.
#include <atomic>
#include <chrono>
#include <functional>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "cpu/backend.h"
#include "gtest/gtest.h"
#include "observe/metrics.h"
#include "run/worker_pool.h"
#include "support/faulty_backend.h"
#include "support/meshes/meshes.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;
using testing::Fault;
using testing::FaultyBackend;

// Ends every wait of a test that goes wrong.
constexpr std::chrono::seconds kPatience{60};

bool WaitUntil(const std::function<bool()>& holds) {
  const auto end = std::chrono::steady_clock::now() + kPatience;
  while (!holds()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(milliseconds(2));
  }
  return true;
}

Fault Breaks(const std::string& kind, int runs = 1, int probes = 0) {
  Fault fault;
  fault.kind = kind;
  fault.stage = "fine_raster";
  fault.runs = runs;
  fault.probes = probes;
  return fault;
}

class BytesSink final : public ResultSink {
 public:
  absl::Status Begin(const ResultHeader&) override {
    ++begins;
    return absl::OkStatus();
  }
  absl::Status Write(size_t, std::span<const uint8_t> bytes) override {
    all.insert(all.end(), bytes.begin(), bytes.end());
    return absl::OkStatus();
  }
  int begins = 0;
  std::vector<uint8_t> all;
};

class TestJob final : public VoxelizeJob {
 public:
  TestJob(std::shared_ptr<const PreparedMesh> of, const JobLimits& job_limits, BackendChoice backend, bool fallback) {
    mesh = std::move(of);
    limits = &job_limits;
    config.request.grid.resolution = 32;
    traits.backend = config.request.backend = backend;
    traits.fallback = fallback;
  }
  absl::Status Planned(const Plan&, bool) override {
    ++plans;
    return absl::OkStatus();
  }
  ResultSink* large_results() override { return stream ? &sink : nullptr; }
  void Done(absl::StatusOr<JobOutcome> outcome) override {
    ++answers;
    answer_.set_value(std::move(outcome));
  }
  absl::StatusOr<JobOutcome> Answer() {
    if (future_.wait_for(kPatience) != std::future_status::ready) return absl::UnknownError("no answer");
    return future_.get();
  }
  bool IsAnswered() const { return future_.wait_for(milliseconds(0)) == std::future_status::ready; }

  bool stream = false;
  BytesSink sink;
  int plans = 0;
  std::atomic<int> answers = 0;

 private:
  std::promise<absl::StatusOr<JobOutcome>> answer_;
  std::future<absl::StatusOr<JobOutcome>> future_ = answer_.get_future();
};

std::vector<uint8_t> BytesOf(const VoxelizeResult& result) {
  std::vector<uint8_t> bytes;
  for (const auto array : ArraysOf(result)) bytes.insert(bytes.end(), array.begin(), array.end());
  return bytes;
}

class FailOverTest : public ::testing::Test {
 protected:
  FailOverTest() {
    auto prepared = std::make_shared<PreparedMesh>();
    prepared->mesh = std::make_shared<const TriangleMesh>(testing::Torus(12));
    mesh_ = std::move(prepared);
    options_.threads = 2;
    options_.health = {.probe_interval = milliseconds(5), .max_probe_interval = milliseconds(20)};
    options_.metrics = &metrics_;
    Use({&gpu_, &cpu::CpuBackend()});
  }
  ~FailOverTest() override {
    gpu_.Set({});  // frees a stalled thread
    pool_.reset();
    EXPECT_TRUE(WaitUntil([] { return WorkerPool::ThreadsLeftBehind() == 0; }));
  }

  void Use(std::initializer_list<const Backend*> devices) {
    options_.devices.clear();
    for (const Backend* device : devices) options_.devices.push_back({device, 1});
  }
  // Jobs that are submitted before the pool starts are taken together.
  void Start() { pool_ = std::make_unique<WorkerPool>(scheduler_, options_, limits_.plan); }

  std::shared_ptr<TestJob> Submit(BackendChoice backend = BackendChoice::kCuda, bool fallback = true,
                                  bool stream = false) {
    auto job = std::make_shared<TestJob>(mesh_, limits_, backend, fallback);
    job->stream = stream;
    EXPECT_TRUE(scheduler_.Submit(job).ok());
    return job;
  }
  std::vector<std::shared_ptr<TestJob>> Submit(int count, bool fallback = true) {
    std::vector<std::shared_ptr<TestJob>> jobs;
    for (int i = 0; i < count; ++i) jobs.push_back(Submit(BackendChoice::kCuda, fallback));
    return jobs;
  }

  std::vector<uint8_t> Expected() {
    const JobContext job;
    VoxelizeRequest request;
    request.grid.resolution = 32;
    return BytesOf(*Voxelize(*mesh_->mesh, request, {.job = job, .backend = &cpu::CpuBackend()}));
  }
  // The answer is right, given once, by a worker of this device at this attempt.
  void ExpectServed(TestJob& job, const std::string& device, uint32_t attempts) {
    const absl::StatusOr<JobOutcome> outcome = job.Answer();
    ASSERT_TRUE(outcome.ok()) << outcome.status();
    EXPECT_EQ(BytesOf(outcome->result), Expected());
    EXPECT_TRUE(absl::StartsWith(outcome->worker, device + "/")) << outcome->worker;
    EXPECT_EQ(outcome->attempts, attempts);
    EXPECT_EQ(job.answers, 1);
    EXPECT_EQ(job.plans, 1) << "what a job needs is taken once";
  }
  bool GpuServes() const { return pool_->Devices()[0].serving; }

  const JobLimits limits_ = [] {
    JobLimits limits;
    limits.plan.slab_bytes = 1024;  // a grid of 32^3 bits takes several slabs, where it is streamed
    return limits;
  }();
  Metrics metrics_;
  FaultyBackend gpu_;
  std::shared_ptr<const PreparedMesh> mesh_;
  Scheduler scheduler_{{.max_queue = 100, .max_batch_jobs = 16}, 2};
  WorkerPoolOptions options_;
  std::unique_ptr<WorkerPool> pool_;
};

TEST_F(FailOverTest, WithoutFaultsTheGpuHasTheJob) {
  const auto job = Submit();
  Start();
  ExpectServed(*job, "cuda:0", 1);
  EXPECT_TRUE(GpuServes());
}

TEST_F(FailOverTest, AJobWhoseGpuIsLostRunsOnTheCpu) {
  gpu_.Set(Breaks("lost"));
  const auto job = Submit();
  Start();
  ExpectServed(*job, "cpu", 2);
}

TEST_F(FailOverTest, ABatchThatDiesInTheMiddleIsAnsweredWholly) {
  gpu_.Set(Breaks("lost", -1, 1'000'000));
  const auto jobs = Submit(8);
  Start();
  for (const auto& job : jobs) ExpectServed(*job, "cpu", 2);
  EXPECT_FALSE(GpuServes());
}

TEST_F(FailOverTest, OnlyTheMembersOfABatchThatFailedRunAgain) {
  gpu_.Set(Breaks("error", 3));
  const auto jobs = Submit(8);
  Start();
  int again = 0;
  for (const auto& job : jobs) {
    const auto outcome = job->Answer();
    ASSERT_TRUE(outcome.ok()) << outcome.status();
    again += outcome->attempts == 2;
    EXPECT_EQ(outcome->attempts == 2, absl::StartsWith(outcome->worker, "cpu/"));
  }
  EXPECT_EQ(again, 3);
  EXPECT_TRUE(GpuServes()) << "others of the same batch went well";
}

TEST_F(FailOverTest, OutOfMemoryABatchIsHalvedAndStays) {
  gpu_.Set(Breaks("memory", 11));  // 8 at once, then 3 of the halves
  const auto jobs = Submit(8);
  Start();
  for (const auto& job : jobs) ExpectServed(*job, "cuda:0", 1);
  EXPECT_TRUE(GpuServes());
}

TEST_F(FailOverTest, AJobThatDoesNotFitAloneGoesElsewhereAndTheDeviceStays) {
  gpu_.Set(Breaks("memory", -1));
  const auto jobs = Submit(4);
  Start();
  for (const auto& job : jobs) ExpectServed(*job, "cpu", 2);
  EXPECT_TRUE(GpuServes());
}

TEST_F(FailOverTest, AJobThatFitsNowhereSaysSo) {
  gpu_.Set(Breaks("memory", -1));
  const auto job = Submit(BackendChoice::kCuda, /*fallback=*/false);
  Start();
  const auto outcome = job->Answer();
  EXPECT_EQ(outcome.status().code(), absl::StatusCode::kResourceExhausted) << outcome.status();
  EXPECT_TRUE(GpuServes());
}

TEST_F(FailOverTest, OutOfMemoryOnADeviceThatFailsItsProbeIsAQuarantine) {
  gpu_.Set(Breaks("memory", -1, 1'000'000));
  const auto job = Submit();
  Start();
  ExpectServed(*job, "cpu", 2);
  EXPECT_TRUE(WaitUntil([&] { return !GpuServes(); }));
}

TEST_F(FailOverTest, ALostDeviceComesBackWhenItsProbeSucceeds) {
  std::mutex mutex;
  std::vector<std::string> heard;
  gpu_.Set(Breaks("lost", 1, 3));
  Start();
  pool_->SetListener([&](const std::string& device, bool serving) {
    const std::lock_guard lock(mutex);
    heard.push_back(absl::StrCat(device, serving ? " serves" : " does not"));
  });
  ExpectServed(*Submit(), "cpu", 2);
  EXPECT_TRUE(WaitUntil([&] { return GpuServes(); }));
  ExpectServed(*Submit(), "cuda:0", 1);
  pool_->SetListener({});
  EXPECT_EQ(heard, (std::vector<std::string>{"cuda:0 serves", "cpu serves", "cuda:0 does not", "cuda:0 serves"}));
  const std::string text = metrics_.Text();
  for (const char* line : {"voxelpipe_device_quarantines_total{device=\"cuda:0\"} 1",
                           "voxelpipe_device_probes_failed_total{device=\"cuda:0\"} 3",
                           "voxelpipe_device_failures_total{device=\"cuda:0\"} 1", "voxelpipe_job_retries_total 1",
                           "voxelpipe_device_serving{device=\"cuda:0\"} 1"}) {
    EXPECT_TRUE(absl::StrContains(text, line)) << line;
  }
}

TEST_F(FailOverTest, TwoErrorsInARowAreAQuarantine) {
  gpu_.Set(Breaks("error", 2, 1'000'000));
  Start();
  ExpectServed(*Submit(), "cpu", 2);
  EXPECT_TRUE(GpuServes());
  ExpectServed(*Submit(), "cpu", 2);
  EXPECT_FALSE(GpuServes());
}

TEST_F(FailOverTest, ASecondGpuComesBeforeTheCpu) {
  FaultyBackend second("cuda:1");
  Use({&gpu_, &second, &cpu::CpuBackend()});
  gpu_.Set(Breaks("lost", -1, 1'000'000));
  second.Set(Breaks("lost", 0));
  const auto jobs = Submit(4);
  Start();
  for (const auto& job : jobs) {
    const auto outcome = job->Answer();
    ASSERT_TRUE(outcome.ok()) << outcome.status();
    EXPECT_TRUE(absl::StartsWith(outcome->worker, "cuda:1/")) << outcome->worker;
  }
  pool_.reset();
}

TEST_F(FailOverTest, WithoutFallbackAFailureIsTheAnswerAndSaysWhenToComeBack) {
  gpu_.Set(Breaks("lost", -1, 1'000'000));
  const auto jobs = Submit(3, /*fallback=*/false);
  Start();
  for (const auto& job : jobs) {
    const auto outcome = job->Answer();
    EXPECT_EQ(outcome.status().code(), absl::StatusCode::kUnavailable) << outcome.status();
    EXPECT_TRUE(RetryDelay(outcome.status()).has_value());
  }
  TaskTraits traits;
  traits.backend = BackendChoice::kCuda;
  traits.fallback = false;
  const absl::Status refused = pool_->CheckServed(traits);
  EXPECT_EQ(refused.code(), absl::StatusCode::kUnavailable);
  EXPECT_TRUE(absl::StrContains(refused.message(), "cuda:0 is quarantined")) << refused;
  EXPECT_TRUE(RetryDelay(refused).has_value());
}

TEST_F(FailOverTest, AnErrorIsTriedAgainOnTheSameDeviceWhereThereIsNoOther) {
  gpu_.Set(Breaks("error", 1));
  const auto job = Submit(BackendChoice::kCuda, /*fallback=*/false);
  Start();
  ExpectServed(*job, "cuda:0", 2);
}

TEST_F(FailOverTest, AKindThatTheServerDoesNotHaveIsAPrecondition) {
  Use({&cpu::CpuBackend()});
  Start();
  TaskTraits traits;
  traits.backend = BackendChoice::kCuda;
  traits.fallback = false;
  EXPECT_EQ(pool_->CheckServed(traits).code(), absl::StatusCode::kFailedPrecondition);
  traits.fallback = true;
  EXPECT_TRUE(pool_->CheckServed(traits).ok());
}

TEST_F(FailOverTest, AttemptsAreBounded) {
  std::vector<std::unique_ptr<FaultyBackend>> gpus;
  options_.devices.clear();
  for (int i = 0; i < 5; ++i) {
    gpus.push_back(std::make_unique<FaultyBackend>(absl::StrCat("cuda:", i)));
    gpus.back()->Set(Breaks("lost", -1, 1'000'000));
    options_.devices.push_back({gpus.back().get(), 1});
  }
  const auto job = Submit();
  Start();
  const auto outcome = job->Answer();
  EXPECT_EQ(outcome.status().code(), absl::StatusCode::kUnavailable) << outcome.status();
  EXPECT_TRUE(absl::StrContains(outcome.status().message(), "failed on 3 workers")) << outcome.status();
  int runs = 0;
  for (const auto& gpu : gpus) runs += gpu->runs();
  EXPECT_EQ(runs, 3);
  pool_.reset();
}

TEST_F(FailOverTest, WhereEverythingFailedWhatWaitsIsRefusedAndTheServerRecovers) {
  Use({&gpu_});
  gpu_.Set(Breaks("lost", -1, 1'000'000));
  auto jobs = Submit(20);  // more than a batch
  Start();
  for (const auto& job : jobs) {
    EXPECT_EQ(job->Answer().status().code(), absl::StatusCode::kUnavailable);
    EXPECT_EQ(job->answers, 1);
  }
  gpu_.Set({});
  EXPECT_TRUE(WaitUntil([&] { return GpuServes(); }));
  ExpectServed(*Submit(), "cuda:0", 1);
}

TEST_F(FailOverTest, AStreamedResultGoesOnWhereItStopped) {
  for (const int slab : {0, 1}) {
    Fault fault = Breaks("lost");
    fault.slab = slab;
    gpu_.Set(fault);
    if (!pool_) Start();
    EXPECT_TRUE(WaitUntil([&] { return GpuServes(); }));
    const auto job = Submit(BackendChoice::kCuda, true, /*stream=*/true);
    const auto outcome = job->Answer();
    ASSERT_TRUE(outcome.ok()) << outcome.status();
    EXPECT_TRUE(outcome->streamed);
    EXPECT_EQ(outcome->attempts, 2u) << slab;
    EXPECT_EQ(job->sink.begins, 1);
    EXPECT_EQ(job->sink.all, Expected()) << "failed in slab " << slab;
  }
}

TEST_F(FailOverTest, AnExceptionOfOneMemberIsNotTheEndOfTheOthers) {
  gpu_.Set(Breaks("throw", 1));
  const auto jobs = Submit(4);
  Start();
  for (const auto& job : jobs) ExpectServed(*job, "cuda:0", 1);
  gpu_.Set(Breaks("throw", 1));
  const auto alone = Submit();
  EXPECT_EQ(alone->Answer().status().code(), absl::StatusCode::kInternal);
  ExpectServed(*Submit(), "cuda:0", 1);
}

TEST_F(FailOverTest, AStalledDeviceLosesItsJobsAndItsThreadIsLeftBehind) {
  options_.stall = milliseconds(500);
  Fault fault = Breaks("stall", -1);
  fault.probe = "stall";
  gpu_.Set(fault);
  const auto jobs = Submit(4);
  Start();
  for (const auto& job : jobs) ExpectServed(*job, "cpu", 2);
  EXPECT_EQ(WorkerPool::ThreadsLeftBehind(), 1u);
  EXPECT_FALSE(GpuServes());
  for (const auto& job : jobs) {
    EXPECT_TRUE(WaitUntil([&] { return job.use_count() == 1; })) << "what is stuck holds no job, and no call with it";
  }
  gpu_.Set({});
  EXPECT_TRUE(WaitUntil([] { return WorkerPool::ThreadsLeftBehind() == 0; }));
  EXPECT_TRUE(WaitUntil([&] { return GpuServes(); })) << "a new worker probed it";
  ExpectServed(*Submit(), "cuda:0", 1);
  for (const auto& job : jobs) EXPECT_EQ(job->answers, 1) << "what the thread made in the end is nobody's";
}

TEST_F(FailOverTest, AStalledDeviceAndAStalledProbeDoNotHoldUpTheEnd) {
  options_.stall = milliseconds(0);  // never
  Fault fault = Breaks("stall", -1);
  fault.stage = "start";  // before anything looks at the cancellation
  fault.probe = "stall";
  gpu_.Set(fault);
  const auto job = Submit();
  Start();
  EXPECT_TRUE(WaitUntil([&] { return gpu_.runs() == 1; }));
  job->context.Cancel();
  pool_->Hasten();
  pool_.reset();
  EXPECT_EQ(job->Answer().status().code(), absl::StatusCode::kCancelled);
  EXPECT_GE(WorkerPool::ThreadsLeftBehind(), 1u);
}

TEST_F(FailOverTest, ACancelReachesAJobOnTheGpu) {
  gpu_.Set(Breaks("stall", 1));
  Start();
  const auto job = Submit();
  EXPECT_TRUE(WaitUntil([&] { return gpu_.runs() == 1; }));
  job->context.Cancel();
  std::this_thread::sleep_for(milliseconds(500));  // far longer than the word takes to the device's copy
  gpu_.Set({});
  EXPECT_EQ(job->Answer().status().code(), absl::StatusCode::kCancelled);
  EXPECT_TRUE(GpuServes());
}

}  // namespace
}  // namespace voxelpipe
