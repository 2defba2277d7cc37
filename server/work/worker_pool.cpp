#include "work/worker_pool.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "cpu/backend.h"
#include "pipeline/batch.h"

namespace voxelpipe {
namespace {

BackendChoice KindOf(const Backend& backend) {
  return backend.name() == "cuda" ? BackendChoice::kCuda : BackendChoice::kCpu;
}

// A result larger than this is made alone: it would hold up the others of a batch.
constexpr uint64_t kLargestOfBatchBytes = 64 << 20;

double QueueMs(const Task& task) {
  return std::chrono::duration<double, std::milli>(JobContext::Clock::now() - task.traits.arrived).count();
}

// Every task of a device worker is one.
VoxelizeJob& JobOf(Task& task) {
  return static_cast<VoxelizeJob&>(task);
}

}  // namespace

WorkerPool::WorkerPool(Scheduler& scheduler, const WorkerPoolOptions& options, const PlanLimits& limits)
    : scheduler_(scheduler), options_(options), limits_(limits) {
  for (int i = 0; i < std::max(1, options.loaders); ++i) threads_.emplace_back([this] { LoadTasks(); });
  for (const DeviceWorkers& device : options.devices) {
    scheduler_.SetDevice({device.backend->device(), KindOf(*device.backend)}, size_t(std::max(1, device.workers)));
    for (int i = 0; i < std::max(1, device.workers); ++i) {
      threads_.emplace_back([this, backend = device.backend, worker = absl::StrCat(device.backend->device(), "/", i)] {
        RunBatches(*backend, worker);
      });
    }
  }
}

WorkerPool::~WorkerPool() {
  scheduler_.Drain();
  scheduler_.Stop();
  for (std::thread& thread : threads_) thread.join();
}

void WorkerPool::LoadTasks() {
  while (std::shared_ptr<Task> task = scheduler_.TakeLoad()) {
    if (task->Load()) {
      scheduler_.Resubmit(std::move(task));
      continue;
    }
    Task& ended = *task;
    scheduler_.Ended(ended);
  }
}

void WorkerPool::RunBatches(const Backend& backend, const std::string& worker) {
  const WorkerTraits traits{backend.device(), KindOf(backend)};
  while (true) {
    std::vector<std::shared_ptr<Task>> batch = scheduler_.TakeBatch(traits);
    if (batch.empty()) return;
    if (batch.size() == 1) {
      RunAlone(backend, worker, JobOf(*batch[0]));
    } else {
      RunTogether(backend, worker, batch);
    }
    for (const std::shared_ptr<Task>& task : batch) scheduler_.Ended(*task);
  }
}

void WorkerPool::RunAlone(const Backend& backend, const std::string& worker, VoxelizeJob& job) {
  const double queue_ms = QueueMs(job);
  ++job.attempts;
  absl::StatusOr<JobOutcome> outcome = Outcome(backend, job);
  if (outcome.ok()) {
    outcome->worker = worker;
    outcome->queue_ms = queue_ms;
    outcome->attempts = job.attempts;
  }
  job.Done(std::move(outcome));
}

absl::StatusOr<JobOutcome> WorkerPool::Outcome(const Backend& backend, VoxelizeJob& job) {
  if (absl::Status s = job.Prepare(); !s.ok()) return s;
  const auto planned = [&](const Plan& plan) { return job.Planned(plan, true); };
  return RunPrepared(backend, *job.mesh, job.config, *job.limits, job.context, planned, job.large_results());
}

void WorkerPool::RunTogether(const Backend& backend, const std::string& worker,
                             std::span<const std::shared_ptr<Task>> batch) {
  struct Member {
    VoxelizeJob* job;
    double queue_ms;
    absl::Status prepared;
    Plan plan;
    bool alone = false;
  };
  std::vector<Member> members;
  for (const std::shared_ptr<Task>& task : batch) members.push_back({&JobOf(*task), QueueMs(*task), {}, {}});
  cpu::CpuBackend().RunEach(options_.threads, members.size(),
                            [&](size_t i) { members[i].prepared = members[i].job->Prepare(); });

  std::vector<BatchItem> items;
  for (Member& member : members) {
    VoxelizeJob& job = *member.job;
    if (!member.prepared.ok()) {
      job.Done(member.prepared);
      continue;
    }
    ++job.attempts;
    BatchItem& item = items.emplace_back();
    item.mesh = job.mesh->mesh.get();
    item.request = &job.config.request;
    item.job = &job.context;
    item.on_plan = [&](const Plan& plan) -> absl::Status {
      member.plan = plan;
      absl::Status s = plan.result_bytes > kLargestOfBatchBytes ? absl::AbortedError("too large for a batch")
                                                                : job.Planned(plan, false);
      member.alone = absl::IsAborted(s);
      return s;
    };
    item.done = [&](absl::StatusOr<VoxelizeResult> result) {
      if (member.alone) return;
      if (!result.ok()) {
        job.Done(result.status());
        return;
      }
      JobOutcome outcome = OutcomeOf(*job.mesh, *std::move(result), member.plan);
      outcome.worker = worker;
      outcome.queue_ms = member.queue_ms;
      outcome.batch_jobs = uint32_t(batch.size());
      outcome.attempts = job.attempts;
      job.Done(std::move(outcome));
    };
  }
  VoxelizeBatch(backend, items, options_.threads, limits_);
  for (const Member& member : members) {
    if (member.alone) RunAlone(backend, worker, *member.job);
  }
}

}  // namespace voxelpipe
