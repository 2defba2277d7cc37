#include "run/device_run.h"

#include <algorithm>
#include <exception>
#include <new>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/device_failure.h"
#include "base/machine.h"
#include "base/threads.h"
#include "run/answer_burst.h"

namespace voxelpipe {
namespace {

// A job with a larger result runs alone: it would delay the others of a batch.
constexpr uint64_t kMaxBatchedBytes = 64 << 20;

// For less work than this, waking a thread costs more than it saves.
constexpr double kMinMsPerThread = 1;
constexpr double kShortMs = 100;

// Jobs predicted to take less defer their responses to the next ones of their batch, by at most this.
constexpr double kTinyMs = 0.1;
constexpr std::chrono::milliseconds kLongestBurst{1};

bool IsOutOfMemory(const absl::Status& status) {
  return DeviceFailureOf(status) == DeviceFailureKind::kOutOfMemory;
}

}  // namespace

int ThreadsFor(double predicted_ms, int limit, int sharers, int cores) {
  const int share = predicted_ms < kShortMs ? std::max(1, cores / std::max(1, sharers)) : cores;
  const int most = limit > 0 ? std::min(limit, share) : share;
  return int(std::clamp(predicted_ms / kMinMsPerThread, 1.0, double(most)));
}

// While it is true, jobs may be called, and the run cannot be abandoned.
class DeviceRun::Inside {
 public:
  explicit Inside(DeviceRun& run) : run_(run) {
    const std::lock_guard lock(run_.mutex_);
    inside_ = !run_.abandoned_;
    if (inside_) ++run_.inside_;
  }
  ~Inside() {
    if (!inside_) return;
    const std::lock_guard lock(run_.mutex_);
    --run_.inside_;
    run_.sign_of_life_ = Clock::now();
  }
  Inside(const Inside&) = delete;
  Inside& operator=(const Inside&) = delete;
  explicit operator bool() const { return inside_; }

 private:
  DeviceRun& run_;
  bool inside_;
};

struct DeviceRun::Member {
  Member(DeviceRun& run, std::shared_ptr<Task> of)
      : task(std::move(of)), job(static_cast<VoxelizeJob*>(task.get())), attempt(job->attempts + 1) {
    // The device is chosen; the one that the request named does not matter any more and may not exist.
    job->config.request.backend = BackendChoice::kAuto;
    queue_ms = std::chrono::duration<double, std::milli>(Clock::now() - task->traits.arrived).count();
    if (!run.options_.watched) {
      config = &job->config;
      context = &job->context;
      return;
    }
    own_config = std::make_unique<ParsedConfig>(job->config);
    own_context = std::make_unique<JobContext>([this, &run](std::string_view stage, double fraction) {
      if (const Inside inside(run); inside) job->context.Report(stage, fraction);
    });
    own_context->set_memory(job->context.memory());
    if (job->context.deadline()) own_context->set_deadline(*job->context.deadline());
    config = own_config.get();
    context = own_context.get();
  }

  // For a run alone; a batch shares its threads.
  void LimitThreads(int threads) { (own_config ? *own_config : job->config).request.threads = threads; }

  std::shared_ptr<Task> task;  // null once the run was abandoned
  VoxelizeJob* job;            // accessed only Inside
  const uint32_t attempt;
  double queue_ms = 0;
  std::shared_ptr<const PreparedMesh> mesh;
  std::unique_ptr<ParsedConfig> own_config;  // if the run is watched
  std::unique_ptr<JobContext> own_context;
  const ParsedConfig* config;
  const JobContext* context;
  Plan plan;
  bool alone = false;     // the batch decided to run it alone
  bool answered = false;  // its Done was called
  absl::Status failure;   // of the device, so far
};

// The sink of a large result, until the run is abandoned.
class DeviceRun::Sink final : public ResultSink {
 public:
  Sink(DeviceRun& run, ResultSink& out) : run_(run), out_(out) {}
  absl::Status Begin(const ResultHeader& header) override {
    const Inside inside(run_);
    return inside ? out_.Begin(header) : Over();
  }
  absl::Status Write(size_t array, std::span<const uint8_t> bytes) override {
    const Inside inside(run_);
    return inside ? out_.Write(array, bytes) : Over();
  }

 private:
  static absl::Status Over() { return absl::CancelledError("the run was abandoned"); }

  DeviceRun& run_;
  ResultSink& out_;
};

DeviceRun::DeviceRun(const Backend& backend, std::vector<std::shared_ptr<Task>> tasks, DeviceRunOptions options)
    : backend_(backend), options_(std::move(options)), limits_{{}, options_.limits} {
  double run_ms = 0;
  members_.reserve(tasks.size());
  for (std::shared_ptr<Task>& task : tasks) {
    const JobCost& cost = task->traits.cost;
    run_ms += cost.run_ms + cost.load_ms;
    members_.push_back(std::make_unique<Member>(*this, std::move(task)));
    ++members_.back()->job->attempts;
  }
  tiny_jobs_ = run_ms < kTinyMs * double(members_.size());
  predicted_ = std::chrono::milliseconds(int64_t(std::min(run_ms, 1e9)));
  options_.threads = ThreadsFor(run_ms, options_.threads, options_.sharers, CpuCount());
  // Jobs of a watched run are copied with it.
  for (const auto& member : members_) member->LimitThreads(options_.threads);
}

DeviceRun::~DeviceRun() = default;

void DeviceRun::Go() {
  absl::Status thrown = absl::InternalError("the device gave no answer");
  try {
    Prepare();
    std::vector<Member*> ready;
    for (const auto& member : members_) {
      if (member->mesh) ready.push_back(member.get());
    }
    if (!ready.empty()) RunSome(ready);
  } catch (const std::exception& error) {
    thrown = absl::InternalError(absl::StrCat("unexpected: ", error.what()));
  }
  Sort(thrown);
}

void DeviceRun::Prepare() {
  const Inside inside(*this);
  if (!inside) return;
  const auto prepare = [&](size_t i) {
    Member& member = *members_[i];
    if (absl::Status s = member.job->Prepare(); !s.ok()) {
      Answer(member, std::move(s));
      return;
    }
    member.mesh = member.job->mesh;
    member.alone = member.job->resumed.begun();
  };
  // If nothing needs loading, the hand-over takes longer than the work.
  const bool at_once =
      std::all_of(members_.begin(), members_.end(), [](const auto& member) { return member->job->prepared_at_once(); });
  if (members_.size() == 1 || at_once) {
    for (size_t i = 0; i < members_.size(); ++i) prepare(i);
  } else {
    RunEachOnThreads(options_.threads, members_.size(), prepare);
  }
}

void DeviceRun::RunSome(std::span<Member* const> members) {
  if (members.size() == 1) {
    RunAlone(*members[0]);
    return;
  }
  std::vector<Member*> together, alone;
  for (Member* member : members) (member->alone ? alone : together).push_back(member);
  if (together.size() == 1) {
    RunAlone(*together[0]);
  } else if (!together.empty()) {
    RunTogether(together);
  }
  std::vector<Member*> smaller;  // jobs that did not fit into the device's memory together
  for (Member* member : together) {
    if (member->alone) {
      alone.push_back(member);
    } else if (together.size() > 1 && IsOutOfMemory(member->failure)) {
      smaller.push_back(member);
    }
  }
  for (Member* member : alone) RunAlone(*member);
  const std::span<Member* const> all(smaller);
  const size_t half = (smaller.size() + 1) / 2;
  if (!smaller.empty()) RunSome(all.first(half));
  if (smaller.size() > half) RunSome(all.subspan(half));
}

absl::Status DeviceRun::Planned(Member& member, const Plan& plan, bool together) {
  const Inside inside(*this);
  if (!inside) return absl::CancelledError("the run was abandoned");
  member.plan = plan;
  if (together && plan.result_bytes > kMaxBatchedBytes) {
    member.alone = true;
    return absl::AbortedError("too large for a batch");
  }
  VoxelizeJob& job = *member.job;
  if (job.planned) return job.context.Check();
  Plan told = plan;
  told.backend = std::string(backend_.name());
  absl::Status s = job.Planned(told, !together);
  job.planned = s.ok();
  member.alone = together && absl::IsAborted(s);
  return s;
}

void DeviceRun::RunAlone(Member& member) {
  std::optional<Sink> sink;
  if (const Inside inside(*this); inside) {
    if (ResultSink* const large = member.job->large_results()) {
      member.job->resumed.SetOut(*large);
      sink.emplace(*this, member.job->resumed);
    }
  }
  const auto planned = [&](const Plan& plan) { return Planned(member, plan, false); };
  absl::StatusOr<JobOutcome> outcome =
      RunPrepared(backend_, *member.mesh, *member.config, limits_, *member.context, planned, sink ? &*sink : nullptr);
  if (outcome.ok()) outcome->batch_jobs = 1;
  Take(member, std::move(outcome));
}

void DeviceRun::RunTogether(std::span<Member* const> members) {
  std::vector<BatchItem> items(members.size());
  for (size_t i = 0; i < members.size(); ++i) {
    Member& member = *members[i];
    member.failure = absl::OkStatus();
    items[i].mesh = member.mesh->mesh.get();
    items[i].request = &member.config->request;
    items[i].job = member.context;
    items[i].on_plan = [&](const Plan& plan) { return Planned(member, plan, true); };
    items[i].done = [&](absl::StatusOr<VoxelizeResult> result) {
      TakeOfBatch(member, std::move(result), uint32_t(members.size()));
    };
  }
  std::optional<AnswerBurst> burst;
  // Not if the device may hang this thread: deferred responses would hang with it.
  if (tiny_jobs_ && !options_.watched) burst.emplace(kLongestBurst);
  absl::Status thrown;
  try {
    VoxelizeBatch(backend_, items, options_.threads, limits_.plan, stats_);
  } catch (const std::bad_alloc&) {
    thrown = absl::ResourceExhaustedError("out of memory");
  } catch (const std::exception& error) {
    thrown = absl::InternalError(absl::StrCat("unexpected: ", error.what()));
  }
  if (thrown.ok()) return;
  // Running each job alone finds the one at fault.
  for (Member* member : members) member->alone |= !member->answered && member->failure.ok();
}

void DeviceRun::TakeOfBatch(Member& member, absl::StatusOr<VoxelizeResult> result, uint32_t jobs) {
  if (member.alone) return;
  if (!result.ok()) {
    Take(member, result.status());
    return;
  }
  JobOutcome outcome = OutcomeOf(*member.mesh, *std::move(result), member.plan);
  outcome.batch_jobs = jobs;
  if (stats_.sharing) outcome.batch_launches = stats_.launches;
  Take(member, std::move(outcome));
}

void DeviceRun::Take(Member& member, absl::StatusOr<JobOutcome> outcome) {
  const Inside inside(*this);
  if (!inside) return;
  if (outcome.ok()) {
    outcome->worker = options_.worker;
    outcome->queue_ms = member.queue_ms;
    outcome->attempts = member.attempt;
    member.failure = absl::OkStatus();
  } else if (member.failure = outcome.status(); DeviceFailureOf(member.failure).has_value()) {
    return;  // for another device
  }
  Answer(member, std::move(outcome));
}

void DeviceRun::Answer(Member& member, absl::StatusOr<JobOutcome> outcome) {
  {
    const std::lock_guard lock(mutex_);
    any_result_ |= outcome.ok();
    member.answered = true;
  }
  member.job->Done(std::move(outcome));
}

void DeviceRun::Sort(const absl::Status& without_answer) {
  const std::lock_guard lock(mutex_);
  if (abandoned_) return;
  for (const auto& member : members_) {
    if (member->answered) {
      answered_.push_back(std::move(member->task));
    } else {
      absl::Status failure = std::move(member->failure);
      if (!DeviceFailureOf(failure)) failure = MarkDeviceFailure(without_answer, DeviceFailureKind::kError);
      left_.push_back({std::move(member->task), std::move(failure)});
    }
  }
}

void DeviceRun::PassOnCancels() {
  const std::lock_guard lock(mutex_);
  if (abandoned_) return;
  for (const auto& member : members_) {
    if (member->task && !member->answered && !member->job->context.Check().ok()) member->own_context->Cancel();
  }
}

DeviceRun::Clock::duration DeviceRun::Silence(Clock::time_point now) const {
  const std::lock_guard lock(mutex_);
  return inside_ > 0 ? Clock::duration::zero() : now - sign_of_life_;
}

bool DeviceRun::Unwanted() const {
  const std::lock_guard lock(mutex_);
  return std::all_of(members_.begin(), members_.end(), [](const auto& member) {
    return !member->task || member->answered || !member->job->context.Check().ok();
  });
}

bool DeviceRun::Abandon(Clock::time_point now, Clock::duration silence) {
  const std::lock_guard lock(mutex_);
  if (abandoned_ || inside_ > 0 || now - sign_of_life_ < silence) return false;
  abandoned_ = true;
  for (const auto& member : members_) {
    if (!member->task) continue;
    if (member->answered) {
      answered_.push_back(std::move(member->task));
    } else {
      left_.push_back({std::move(member->task), {}});
    }
  }
  return true;
}

}  // namespace voxelpipe
