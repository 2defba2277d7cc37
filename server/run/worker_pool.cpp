#include "run/worker_pool.h"

#include <algorithm>
#include <atomic>
#include <exception>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "base/device_failure.h"
#include "base/machine.h"
#include "base/threads.h"
#include "observe/log.h"
#include "observe/metrics.h"
#include "run/worker_pool_state.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kMinRetryDelay{100};
constexpr double kShortLoadMs = 100;
// Share of a device's memory for the prediction of one batch: other workers and cached meshes need the rest.
constexpr uint64_t kBatchShare = 4;

BackendChoice KindOf(const Backend& backend) {
  return backend.name() == "cuda" ? BackendChoice::kCuda : BackendChoice::kCpu;
}

const char* KindName(BackendChoice kind) {
  return kind == BackendChoice::kCuda ? "cuda" : kind == BackendChoice::kCpu ? "cpu" : "auto";
}

// Every task of a device worker is one.
VoxelizeJob& JobOf(Task& task) {
  return static_cast<VoxelizeJob&>(task);
}

absl::Status CallProbe(const Backend& backend) {
  try {
    return backend.Probe();
  } catch (const std::exception& error) {
    return absl::InternalError(absl::StrCat("the probe threw: ", error.what()));
  }
}

std::string Words(const absl::Status& status) {
  return std::string(status.message());
}

}  // namespace

std::atomic<size_t> WorkerPool::left_behind_{0};

WorkerPool::Device::Device(const DeviceWorkers& of, const WorkerPoolOptions& options)
    : backend(*of.backend),
      traits{of.backend->device(), KindOf(*of.backend), of.backend->memory_bytes() / kBatchShare},
      workers(std::max(1, of.workers)),
      // A thread of the CPU backend cannot hang in a device; on an overloaded machine it may only seem so.
      watched(traits.kind != BackendChoice::kCpu),
      metrics(options.metrics == nullptr ? nullptr : &options.metrics->Device(traits.device)),
      health(options.health) {
  if (metrics == nullptr) return;
  metrics->serving.Set(1);
  metrics->workers.Set(workers);
}

WorkerPool::WorkerPool(Scheduler& scheduler, const WorkerPoolOptions& options, const PlanLimits& limits)
    : scheduler_(scheduler), options_(options), limits_(limits) {
  for (const DeviceWorkers& workers : options.devices) {
    devices_.push_back(std::make_shared<Device>(workers, options_));
    scheduler_.SetDevice(devices_.back()->traits, size_t(devices_.back()->workers));
  }
  StartLoaders(std::max(1, options.loaders) + options.spare_loaders);
  for (const auto& device : devices_) {
    const std::lock_guard lock(device->mutex);
    for (int i = 0; i < device->workers; ++i) StartWorker(device);
  }
  watch_ = std::thread([this] { Watch(); });
}

WorkerPool::~WorkerPool() {
  scheduler_.Drain();
  for (const auto& device : devices_) {
    const std::lock_guard lock(device->mutex);
    device->stopping = true;
    device->changed.notify_all();
  }
  scheduler_.Stop();
  for (std::thread& thread : loaders_) thread.join();
  // A worker may hang in a probe until the watch abandons it, so the watch ends last.
  Hasten();
  for (const auto& device : devices_) {
    std::unique_lock lock(device->mutex);
    device->changed.wait(lock, [&] {
      return std::all_of(device->crew.begin(), device->crew.end(), [](const auto& worker) { return worker->ended; });
    });
    const auto crew = std::move(device->crew);
    device->crew.clear();
    lock.unlock();
    for (const auto& worker : crew) worker->thread.join();
  }
  {
    const std::lock_guard lock(watch_mutex_);
    stopping_ = true;
  }
  watch_changed_.notify_all();
  watch_.join();
}

void WorkerPool::StartLoaders(int count) {
  while (int(loaders_.size()) < count) loaders_.emplace_back([this] { LoadTasks(); });
}

void WorkerPool::Resize(int loaders, int cpu_workers) {
  const std::lock_guard resize(resize_mutex_);
  StartLoaders(std::max(1, loaders) + options_.spare_loaders);
  scheduler_.SetLoaders(size_t(std::max(1, loaders)));
  const std::lock_guard change(change_mutex_);
  for (const auto& device : devices_) {
    if (device->watched || device->workers == cpu_workers) continue;
    {
      const std::lock_guard lock(device->mutex);
      if (device->stopping) return;
      device->workers = std::max(1, cpu_workers);
      while (device->crew.size() < size_t(device->workers)) StartWorker(device);
      device->changed.notify_all();
    }
    if (device->metrics != nullptr) device->metrics->workers.Set(device->workers);
    if (device->told_serving) scheduler_.SetDevice(device->traits, size_t(device->workers));
  }
}

void WorkerPool::LoadTasks() {
  while (std::shared_ptr<Task> task = scheduler_.TakeLoad()) {
    // If others load or run too, threads beyond this run's share of the CPUs would only wait for theirs. Long runs get
    // all: they outlast those that share the CPUs now.
    const int sharers = ++loads_ + cpu_runs_;
    const bool shares = task->traits.cost.load_ms < kShortLoadMs;
    bool ready = false;
    RunOnThreads(shares ? std::max(1, CpuCount() / sharers) : 0, [&] { ready = task->Load(); });
    --loads_;
    if (ready) {
      scheduler_.Resubmit(std::move(task));
      continue;
    }
    Task& ended = *task;
    scheduler_.Ended(ended);
  }
}

void WorkerPool::StartWorker(const std::shared_ptr<Device>& device) {
  const int number = device->next_number++;
  auto worker = std::make_shared<Worker>(device, number, absl::StrCat(device->traits.device, "/", number));
  device->crew.push_back(worker);
  worker->thread = std::thread(Work, this, worker);
}

void WorkerPool::Work(WorkerPool* pool, std::shared_ptr<Worker> self) {
  Device& device = *self->device;
  while (pool->WaitUntilServing(*self)) {
    std::vector<std::shared_ptr<Task>> batch = pool->scheduler_.TakeBatch(device.traits);
    // Empty: the device no longer serves, or the pool ends.
    if (!batch.empty() && !pool->RunBatch(*self, std::move(batch))) break;
  }
  const std::lock_guard lock(device.mutex);
  self->ended = true;
  if (self->is_left_behind) {
    --device.away;
    --left_behind_;
  } else {
    device.changed.notify_all();
  }
}

bool WorkerPool::RunBatch(Worker& self, std::vector<std::shared_ptr<Task>> batch) {
  Device& device = *self.device;
  const Clock::time_point begin = Clock::now();
  if (device.metrics != nullptr) device.metrics->workers_busy.Increment();
  const int sharers = device.watched ? 1 : ++cpu_runs_ + loads_;
  const auto run =
      std::make_shared<DeviceRun>(device.backend, std::move(batch),
                                  DeviceRunOptions{self.name, options_.threads, sharers, limits_, device.watched});
  {
    const std::lock_guard lock(device.mutex);
    self.run = run;
  }
  if (device.watched) WakeWatch();
  run->Go();
  if (!device.watched) --cpu_runs_;
  {
    const std::lock_guard lock(device.mutex);
    if (self.is_left_behind) return false;
    self.run.reset();
  }
  if (device.metrics != nullptr) {
    device.metrics->workers_busy.Decrement();
    device.metrics->busy_seconds.Increment(std::chrono::duration<double>(Clock::now() - begin).count());
  }
  if (!Settle(device, *run)) return true;
  // A single job did not fit into the device's memory. Either it is too large, or the device is faulty.
  absl::Status probe;
  {
    std::unique_lock lock(device.mutex);
    if (device.stopping) return true;
    if (!Probe(self, lock, probe)) return false;
  }
  if (!probe.ok()) Failed(device, DeviceFailureKind::kLost, "out of memory, and then: " + Words(probe));
  return true;
}

bool WorkerPool::WaitUntilServing(Worker& self) {
  Device& device = *self.device;
  std::unique_lock lock(device.mutex);
  // The CPU may have more threads than its current number of workers.
  const auto spare = [&] { return !device.watched && self.number >= device.workers; };
  while (!device.stopping && (spare() || !device.health.serving())) {
    if (spare()) {
      device.changed.wait(lock);
      continue;
    }
    if (!device.health.BeginProbe(Clock::now())) {
      if (const auto due = device.health.next_probe()) {
        device.changed.wait_until(lock, *due);
      } else {
        device.changed.wait(lock);
      }
      continue;
    }
    absl::Status outcome;
    if (!Probe(self, lock, outcome)) return false;
    const bool serves = device.health.Probed(outcome, Clock::now());
    if (!serves && device.metrics != nullptr) device.metrics->probes_failed.Increment();
    lock.unlock();
    if (!serves) {
      LogMessage(LogLevel::kInfo,
                 absl::StrCat("device ", device.traits.device, ": stays in quarantine: ", Words(outcome)));
    }
    Changed(device);
    lock.lock();
  }
  return !device.stopping;
}

bool WorkerPool::Probe(Worker& self, std::unique_lock<std::mutex>& lock, absl::Status& outcome) {
  self.probing_since = Clock::now();
  lock.unlock();
  WakeWatch();
  outcome = CallProbe(self.device->backend);
  lock.lock();
  if (self.is_left_behind) return false;
  self.probing_since.reset();
  return true;
}

bool WorkerPool::Settle(Device& device, const DeviceRun& run) {
  scheduler_.Ended(run.answered());
  if (device.metrics != nullptr) {
    device.metrics->batches.Increment();
    device.metrics->jobs.Increment(double(run.answered().size() + run.left().size()));
    if (run.launches() > 0) device.metrics->launches.Increment(double(run.launches()));
  }
  if (options_.metrics != nullptr) {
    const auto fell_back = std::count_if(run.answered().begin(), run.answered().end(),
                                         [&](const auto& task) { return IsFallback(task->traits, device.traits); });
    if (fell_back > 0) options_.metrics->job_fallbacks.Increment(double(fell_back));
  }
  if (run.any_result()) {
    const std::lock_guard lock(device.mutex);
    device.health.Succeeded();
  }
  if (run.left().empty()) return false;
  // Counts the worst failure of a batch, once.
  const DeviceRun::Left* worst = nullptr;
  bool out_of_memory = false;
  const auto rank = [](const DeviceRun::Left& left) {
    const auto kind = DeviceFailureOf(left.failure);
    return kind == DeviceFailureKind::kLost ? 2 : kind == DeviceFailureKind::kError ? 1 : 0;
  };
  for (const DeviceRun::Left& left : run.left()) {
    if (worst == nullptr || rank(left) > rank(*worst)) worst = &left;
    out_of_memory |= rank(left) == 0;
  }
  Failed(device, *DeviceFailureOf(worst->failure), Words(worst->failure));
  for (const DeviceRun::Left& left : run.left()) FailOver(device, left.task, left.failure);
  return out_of_memory;
}

void WorkerPool::FailOver(const Device& device, std::shared_ptr<Task> task, const absl::Status& failure) {
  VoxelizeJob& job = JobOf(*task);
  const auto end = [&](absl::Status why) {
    job.Done(std::move(why));
    scheduler_.Ended(job);
  };
  if (absl::Status s = job.context.Check(); !s.ok()) return end(std::move(s));
  TaskTraits& traits = task->traits;
  const bool out_of_memory = DeviceFailureOf(failure) == DeviceFailureKind::kOutOfMemory;
  const std::string what = absl::StrCat("the job failed on ", job.attempts, job.attempts == 1 ? " worker" : " workers",
                                        ", last on ", device.traits.device, ": ", Words(failure));
  const auto give_up = [&] {
    end(out_of_memory ? absl::ResourceExhaustedError(what) : NotServingError(what, kMinRetryDelay));
  };
  if (job.attempts >= options_.max_attempts) return give_up();
  traits.excluded_devices.push_back(device.traits.device);
  if (!scheduler_.IsServed(traits)) {
    // The same device may succeed the next time, but will not have more memory.
    if (out_of_memory) return give_up();
    traits.excluded_devices.clear();
    if (absl::Status s = CheckServed(traits); !s.ok()) return give_up();
  }
  LogMessage(LogLevel::kInfo, absl::StrCat("a job of ", traits.client, " that failed on ", device.traits.device,
                                           " runs again elsewhere: ", Words(failure)));
  if (options_.metrics != nullptr) options_.metrics->job_retries.Increment();
  scheduler_.Resubmit(std::move(task));
}

void WorkerPool::Failed(Device& device, DeviceFailureKind kind, const std::string& reason) {
  if (device.metrics != nullptr) device.metrics->failures.Increment();
  bool quarantined;
  {
    const std::lock_guard lock(device.mutex);
    quarantined = device.health.Failed(kind, reason, Clock::now());
  }
  LogMessage(LogLevel::kWarn, absl::StrCat("device ", device.traits.device, " failed",
                                           quarantined ? " and is quarantined" : "", ": ", reason));
  if (!quarantined) return;
  if (device.metrics != nullptr) device.metrics->quarantines.Increment();
  Changed(device);
  RefuseStranded();
  WakeWatch();
}

void WorkerPool::Changed(Device& device) {
  const std::lock_guard change(change_mutex_);
  bool serving;
  {
    const std::lock_guard lock(device.mutex);
    serving = device.health.serving();
  }
  if (serving == device.told_serving) return;
  device.told_serving = serving;
  scheduler_.SetDevice(device.traits, serving ? size_t(device.workers) : 0);
  if (device.metrics != nullptr) device.metrics->serving.Set(serving ? 1 : 0);
  if (serving) LogMessage(LogLevel::kInfo, absl::StrCat("device ", device.traits.device, ": serves again"));
  if (listener_) listener_(device.traits.device, serving);
  device.changed.notify_all();
}

void WorkerPool::RefuseStranded() {
  for (const std::shared_ptr<Task>& task : scheduler_.TakeStranded()) {
    absl::Status why = CheckServed(task->traits);
    // It failed elsewhere before, or a device just returned to service.
    if (why.ok()) why = NotServingError("the devices that could run this failed", kMinRetryDelay);
    task->Refuse(std::move(why));
  }
}

absl::Status WorkerPool::CheckServed(const TaskTraits& task) const {
  if (scheduler_.IsServed(task)) return absl::OkStatus();
  std::vector<ServingDevice> all;
  for (const auto& device : devices_) all.push_back({device->traits, size_t(device->workers)});
  if (!AnyMayHave(task, all)) {
    if (task.backend == BackendChoice::kCuda && !options_.why_no_gpu.empty()) {
      return absl::FailedPreconditionError(options_.why_no_gpu);
    }
    return absl::FailedPreconditionError(
        absl::StrCat("backend: this server has no ", KindName(task.backend), " worker"));
  }
  const Clock::time_point now = Clock::now();
  auto delay = std::chrono::duration_cast<milliseconds>(options_.health.max_probe_interval);
  std::vector<std::string> reasons;
  for (const auto& device : devices_) {
    const std::lock_guard lock(device->mutex);
    if (device->health.serving() || !MayHave(task, device->traits, all)) continue;
    reasons.push_back(absl::StrCat(device->traits.device, " is quarantined (", device->health.reason(), ")"));
    const auto due = device->health.next_probe().value_or(now);
    delay = std::min(delay, std::chrono::ceil<milliseconds>(due - now));
  }
  return NotServingError(absl::StrCat("no device that may run this serves now: ", absl::StrJoin(reasons, "; ")),
                         std::max(delay, kMinRetryDelay));
}

absl::StatusOr<const Backend*> WorkerPool::FindDevice(const TaskTraits& task) const {
  std::vector<ServingDevice> serving;
  std::vector<const Backend*> backends;
  for (const auto& device : devices_) {
    const std::lock_guard lock(device->mutex);
    if (!device->health.serving()) continue;
    serving.push_back({device->traits, size_t(device->workers)});
    backends.push_back(&device->backend);
  }
  for (size_t i = 0; i < serving.size(); ++i) {
    if (MayHave(task, serving[i].traits, serving)) return backends[i];
  }
  absl::Status why = CheckServed(task);
  return why.ok() ? NotServingError("a device just began to serve again", kMinRetryDelay) : why;
}

std::vector<DeviceReport> WorkerPool::Devices() const {
  std::vector<DeviceReport> reports;
  for (const auto& device : devices_) {
    const std::lock_guard lock(device->mutex);
    reports.push_back({&device->backend, device->workers, device->health.serving(), device->health.reason()});
  }
  return reports;
}

BackendChoice WorkerPool::best_kind() const {
  return devices_.empty() ? BackendChoice::kCpu : devices_.front()->traits.kind;
}

void WorkerPool::SetListener(std::function<void(const std::string&, bool)> listener) {
  const std::lock_guard change(change_mutex_);
  listener_ = std::move(listener);
  if (!listener_) return;
  for (const auto& device : devices_) listener_(device->traits.device, device->told_serving);
}

size_t WorkerPool::ThreadsLeftBehind() {
  return left_behind_;
}

}  // namespace voxelpipe
