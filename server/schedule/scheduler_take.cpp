// How workers take tasks from the queue, and the end of tasks.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "observe/metrics.h"
#include "schedule/batch_room.h"
#include "schedule/scheduler.h"
#include "schedule/scheduler_lanes.h"

namespace voxelpipe {
namespace {

double MsBetween(JobContext::Clock::time_point from, JobContext::Clock::time_point to) {
  return std::chrono::duration<double, std::milli>(to - from).count();
}

uint32_t BitOf(BackendChoice kind) {
  return 1u << unsigned(kind);
}

}  // namespace

// ---- the next task

bool Scheduler::KindServes(BackendChoice kind) const {
  return std::any_of(serving_.begin(), serving_.end(), [&](const ServingDevice& d) { return d.traits.kind == kind; });
}

const ServingDevice* Scheduler::Serving(const std::string& device) const {
  const auto it =
      std::find_if(serving_.begin(), serving_.end(), [&](const ServingDevice& d) { return d.traits.device == device; });
  return it == serving_.end() ? nullptr : &*it;
}

void Scheduler::SetDevice(const WorkerTraits& device, size_t workers) {
  std::vector<Sleeper*> called;
  {
    const std::lock_guard lock(mutex_);
    const bool served = KindServes(device.kind);
    std::erase_if(serving_, [&](const ServingDevice& d) { return d.traits.device == device.device; });
    if (workers > 0) serving_.push_back({device, workers});
    uint32_t kinds = 0;
    for (const ServingDevice& d : serving_) kinds |= BitOf(d.traits.kind);
    serving_kinds_.store(kinds, std::memory_order_relaxed);
    if (KindServes(device.kind) != served) {  // tasks that name this kind but allow fallback change lanes
      std::vector<const Task*> moved;
      to_run_.ForEach([&](const Task& task) {
        if (task.traits.backend == device.kind && task.traits.fallback) moved.push_back(&task);
      });
      for (const Task* task : moved) to_run_.Move(*task, LaneOf(task->traits));
    }
    called = CallAll();
  }
  for (Sleeper* sleeper : called) Notify(sleeper);
}

std::vector<std::shared_ptr<Task>> Scheduler::TakeStranded() {
  std::vector<std::shared_ptr<Task>> stranded;
  const std::lock_guard lock(mutex_);
  std::vector<const Task*> found;
  const auto look = [&](const Task& task) {
    if (!AnyMayHave(task.traits, serving_)) found.push_back(&task);
  };
  to_run_.ForEach(look);
  for (const std::shared_ptr<Task>& task : again_) look(*task);
  for (const Task* task : found) stranded.push_back(Dequeue(*task));
  if (draining_ && IdleLocked()) drained_.notify_all();
  return stranded;
}

bool Scheduler::IsServed(const TaskTraits& task) const {
  if (task.excluded_devices.empty()) {
    const uint32_t kinds = serving_kinds_.load(std::memory_order_relaxed);
    const bool any = task.backend == BackendChoice::kAuto || task.fallback;
    return any ? kinds != 0 : (kinds & BitOf(task.backend)) != 0;
  }
  const std::lock_guard lock(mutex_);
  return AnyMayHave(task, serving_);
}

KindOutlook Scheduler::Outlook(const TaskTraits& task, BackendChoice kind, Time now) const {
  KindOutlook outlook;
  for (const ServingDevice& device : serving_) {
    if (device.traits.kind == kind && MayHave(task, device.traits, serving_)) outlook.workers += device.workers;
  }
  const WorkKind work = kind == BackendChoice::kCuda ? WorkKind::kCuda : WorkKind::kCpu;
  size_t busy = 0;
  std::optional<double> first;
  for (const std::shared_ptr<Batch>& batch : running_) {
    if (batch->kind != work) continue;
    ++busy;
    // A task that takes longer than predicted may take as long again.
    const double left = std::abs(batch->expected_ms - MsBetween(batch->began, now));
    first = std::min(first.value_or(left), left);
  }
  outlook.idle = outlook.workers - std::min(outlook.workers, busy);
  if (outlook.idle == 0) outlook.free_in_ms = first.value_or(0);
  outlook.task_ms = RunMsOn(task, kind);
  return outlook;
}

bool Scheduler::Leaves(const TaskTraits& task, const WorkerTraits& worker, size_t waiting, Time now,
                       std::optional<Time>* look_again) const {
  if (task.backend != BackendChoice::kAuto) return false;
  const KindOutlook cpu = Outlook(task, BackendChoice::kCpu, now);
  KindOutlook gpu = Outlook(task, BackendChoice::kCuda, now);
  gpu.waiting_ms = to_run_.waiting_ms(LanesOfKind(BackendChoice::kAuto) | LanesOfKind(BackendChoice::kCuda));
  if (!LeavesToOtherKind(worker.kind, cpu, gpu, waiting)) return false;
  if (look_again != nullptr && worker.kind == BackendChoice::kCpu && gpu.idle == 0) {
    // If no batch of the GPUs ends by then, the prediction was wrong and the CPU is the better choice.
    const double spare = cpu.task_ms - (GpusDoneInMs(gpu) - gpu.free_in_ms);
    for (const std::shared_ptr<Batch>& batch : running_) {
      if (batch->kind != WorkKind::kCuda) continue;
      const auto ms = std::chrono::duration<double, std::milli>(batch->expected_ms + std::max(0.0, spare) + 1);
      const Time then = batch->began + std::chrono::ceil<JobContext::Clock::duration>(ms);
      if (then > now) *look_again = std::min(look_again->value_or(then), then);
    }
  }
  return true;
}

FairQueue::Lanes Scheduler::RunLanes(const WorkerTraits& worker, std::optional<Time>* look_again) const {
  FairQueue::Lanes lanes = LanesOfKind(worker.kind);
  const FairQueue::Lanes anyones = LanesOfKind(BackendChoice::kAuto) & to_run_.lanes();
  const bool choice = anyones != 0 && KindServes(BackendChoice::kCpu) && KindServes(BackendChoice::kCuda);
  if (!choice) {
    lanes |= LanesOfKind(BackendChoice::kAuto);
  } else {
    const Time now = Now();
    for (const SizeClass size : {SizeClass::kSmall, SizeClass::kMedium, SizeClass::kGiant}) {
      const size_t lane = LaneFor(BackendChoice::kAuto, size);
      const Task* front = to_run_.Front(FairQueue::Lanes{1} << lane);
      // No other task waits for a giant's worker.
      const bool gpus_giant = size == SizeClass::kGiant && worker.kind == BackendChoice::kCuda;
      const size_t waiting = to_run_.size();
      if (front != nullptr && (gpus_giant || !Leaves(front->traits, worker, waiting, now, look_again))) {
        lanes |= FairQueue::Lanes{1} << lane;
      }
    }
  }
  const ServingDevice* device = Serving(worker.device);
  const size_t workers = device == nullptr ? 1 : device->workers;
  const auto giants = giants_.find(worker.device);
  if (giants != giants_.end() && giants->second >= std::max<size_t>(2, workers) - 1) {
    lanes &= ~LanesOfSize(SizeClass::kGiant);
  }
  return lanes;
}

Scheduler::LoadChoice Scheduler::NextLoad() const {
  LoadChoice choice;
  if (to_load_.size() == 0) return choice;
  if (loading_.size() < loaders_ && (ready_bytes_ < options_.max_ready_bytes || to_run_.size() == 0)) {
    const bool full = giants_loading_ >= std::max<size_t>(2, loaders_) - 1;
    choice.lanes = full ? FairQueue::kAllLanes & ~LanesOfSize(SizeClass::kGiant) : FairQueue::kAllLanes;
    choice.first = to_load_.Front(choice.lanes, &choice.lane);
    if (choice.first != nullptr) return choice;
  }
  choice.lanes = FairQueue::kAllLanes;
  choice.skip = [this](const std::string& client) {
    const auto its = [&](const Loading& loading) { return loading.client == client; };
    return std::any_of(loading_.begin(), loading_.end(), its) || to_run_.WaitingOf(client) > 0;
  };
  choice.first = to_load_.Front(choice.lanes, &choice.lane, choice.skip);
  return choice;
}

// ---- removal

std::vector<std::shared_ptr<Task>> Scheduler::FormBatch(const WorkerTraits& worker, bool may_delay, Time now,
                                                        std::optional<Time>& come_again,
                                                        std::optional<Time>& look_again) {
  auto batch = std::make_shared<Batch>();
  batch->kind = worker.kind == BackendChoice::kCuda ? WorkKind::kCuda : WorkKind::kCpu;
  batch->device = worker.device;
  batch->began = now;
  for (auto it = again_.begin(); it != again_.end(); ++it) {
    if (!MayHave((*it)->traits, worker, serving_)) continue;
    if (Leaves((*it)->traits, worker, to_run_.size() + again_.size(), now, &look_again)) continue;
    std::vector<std::shared_ptr<Task>> alone{std::move(*it)};
    again_.erase(it);
    Forget(*alone[0]);
    batch->measurable = false;  // its class is unknown now
    batch->expected_ms = RunMsOn(alone[0]->traits, worker.kind);
    running_.push_back(batch);
    Take(alone[0], batch);
    return alone;
  }

  FairQueue::Lanes lanes = RunLanes(worker, &look_again);
  size_t lane = 0;
  const Task* first = to_run_.Front(lanes, &lane);
  if (first == nullptr) return {};
  const SizeClass size = SizeOfLane(lane);
  lanes &= LanesOfSize(size);
  size_t ready = 0;
  for (size_t l = 0; l < FairQueue::kLanes; ++l) ready += (lanes >> l & 1) != 0 ? to_run_.size(l) : 0;
  if (may_delay && size == SizeClass::kSmall && ready < options_.max_batch_jobs && ready_since_ &&
      now < *ready_since_ + options_.batch_delay && !stopped_ && !draining_) {
    come_again = *ready_since_ + options_.batch_delay;
    return {};
  }

  // Idle workers get their share of the tasks.
  size_t takers = 1;
  for (const std::vector<Sleeper*>* sleepers : {&asleep_, &called_}) {
    for (const Sleeper* sleeper : *sleepers) {
      if (sleeper->worker != nullptr && (RunLanes(*sleeper->worker) & lanes & to_run_.lanes()) != 0) ++takers;
    }
  }
  BatchRoom room({std::min(options_.max_batch_jobs, (ready + takers - 1) / takers), options_.max_batch_ms,
                  options_.max_batch_bytes, worker.batch_device_bytes});
  batch->size = size;
  // A CPU worker takes at most the tasks that it ends before the GPUs have ended the others.
  double most_ms = std::numeric_limits<double>::infinity();
  if (first->traits.backend == BackendChoice::kAuto && worker.kind == BackendChoice::kCpu &&
      KindServes(BackendChoice::kCuda)) {
    KindOutlook gpu = Outlook(first->traits, BackendChoice::kCuda, now);
    gpu.waiting_ms = to_run_.waiting_ms(LanesOfKind(BackendChoice::kAuto) | LanesOfKind(BackendChoice::kCuda));
    most_ms = GpusDoneInMs(gpu);
  }
  std::vector<std::shared_ptr<Task>> tasks;
  tasks.reserve(size == SizeClass::kGiant ? 1 : std::min(ready, options_.max_batch_jobs));
  for (const Task* next = first; next != nullptr; next = to_run_.Front(lanes)) {
    const double ms = RunMsOn(next->traits, worker.kind);
    if (!room.Fits(next->traits.cost, ms)) break;
    if (!tasks.empty() && batch->expected_ms + ms > most_ms) break;
    room.Add(next->traits.cost, ms);
    batch->expected_ms += ms;
    batch->predicted_ms += next->traits.cost.run_ms + next->traits.cost.load_ms;
    tasks.push_back(to_run_.Pop(lanes));
    ready_bytes_ -= std::min(ready_bytes_, tasks.back()->traits.cost.held_bytes);
    Forget(*tasks.back());
    Take(tasks.back(), batch);
    if (size == SizeClass::kGiant) break;
  }
  running_.push_back(batch);
  if (size == SizeClass::kGiant) ++giants_[worker.device];
  if (to_run_.size() == 0) ready_since_.reset();
  return tasks;
}

void Scheduler::Take(const std::shared_ptr<Task>& task, const std::shared_ptr<Batch>& batch) {
  ++batch->left;
  taken_[task.get()] = batch;
}

void Scheduler::TellTaken(std::span<const std::shared_ptr<Task>> batch, Time now) const {
  if (options_.metrics == nullptr || batch.empty()) return;
  for (const std::shared_ptr<Task>& task : batch) {
    options_.metrics->QueueWait(size_t(task->traits.priority)).Observe(MsBetween(task->traits.arrived, now) * 1e-3);
  }
  options_.metrics->batch_jobs.Observe(double(batch.size()));
}

std::vector<std::shared_ptr<Task>> Scheduler::TakeBatch(const WorkerTraits& worker) {
  bool may_delay = options_.batch_delay.count() > 0;
  std::vector<std::shared_ptr<Task>> batch;
  Sleeper* next = nullptr;
  Time now;
  {
    std::unique_lock lock(mutex_);
    while (Serving(worker.device) != nullptr) {
      now = Now();
      std::optional<Time> come_again, look_again;
      batch = FormBatch(worker, may_delay, now, come_again, look_again);
      if (!batch.empty() || stopped_) break;
      Sleeper& sleeper = Sleep(&worker, come_again ? options_.max_batch_jobs : 1);
      const auto woken = [&] { return sleeper.called || stopped_; };
      if (come_again || look_again) {
        sleeper.wake.wait_until(lock, come_again ? *come_again : *look_again, woken);
      } else {
        sleeper.wake.wait(lock, woken);
      }
      if (!come_again) may_delay = false;
      WokeUp(sleeper);
    }
    next = CallOne();  // another worker may take the remaining tasks
  }
  Notify(next);
  TellTaken(batch, now);
  return batch;
}

std::vector<std::shared_ptr<Task>> Scheduler::TryTakeBatch(const WorkerTraits& worker) {
  std::vector<std::shared_ptr<Task>> batch;
  const Time now = Now();
  {
    const std::lock_guard lock(mutex_);
    if (Serving(worker.device) == nullptr) return batch;
    std::optional<Time> come_again, look_again;
    batch = FormBatch(worker, options_.batch_delay.count() > 0, now, come_again, look_again);
  }
  TellTaken(batch, now);
  return batch;
}

std::shared_ptr<Task> Scheduler::TakeLoadLocked() {
  const LoadChoice choice = NextLoad();
  if (choice.first == nullptr) return nullptr;
  std::shared_ptr<Task> task = to_load_.Pop(choice.lanes, choice.skip);
  auto batch = std::make_shared<Batch>();
  batch->kind = WorkKind::kLoad;
  batch->size = SizeOfLane(choice.lane);
  batch->predicted_ms = task->traits.cost.load_ms;
  batch->began = Now();
  if (batch->size == SizeClass::kGiant) ++giants_loading_;
  Forget(*task);
  Take(task, batch);
  const TaskTraits& traits = task->traits;
  loading_.push_back({task.get(), traits.client, traits.cost.held_bytes, RunMs(traits)});
  return task;
}

std::shared_ptr<Task> Scheduler::TakeLoad() {
  // Loaded tasks, which pause loading, also leave the queue without a callback: withdrawn, or past their deadlines.
  constexpr std::chrono::milliseconds kLookAgain{20};
  std::shared_ptr<Task> task;
  Sleeper* next = nullptr;
  {
    std::unique_lock lock(mutex_);
    while ((task = TakeLoadLocked()) == nullptr) {
      if (stopped_) return nullptr;
      Sleeper& sleeper = Sleep(nullptr, 1);
      const auto woken = [&] { return sleeper.called || stopped_; };
      if (to_load_.size() > 0 && ready_bytes_ >= options_.max_ready_bytes) {
        sleeper.wake.wait_for(lock, kLookAgain, woken);
      } else {
        sleeper.wake.wait(lock, woken);
      }
      WokeUp(sleeper);
    }
    next = CallOne();
  }
  Notify(next);
  return task;
}

std::shared_ptr<Task> Scheduler::TryTakeLoad() {
  const std::lock_guard lock(mutex_);
  return TakeLoadLocked();
}

void Scheduler::SetLoaders(size_t loaders) {
  std::vector<Sleeper*> called;
  {
    const std::lock_guard lock(mutex_);
    loaders_ = std::max<size_t>(1, loaders);
    called = CallAll();
  }
  for (Sleeper* sleeper : called) Notify(sleeper);
}

// ---- sleeping threads

Scheduler::Sleeper& Scheduler::Sleep(const WorkerTraits* worker, size_t enough) {
  if (spare_.empty()) {
    sleepers_.push_back(std::make_unique<Sleeper>());
    spare_.push_back(sleepers_.back().get());
  }
  Sleeper& sleeper = *spare_.back();
  spare_.pop_back();
  sleeper.worker = worker;
  sleeper.enough = enough;
  sleeper.called = false;
  asleep_.push_back(&sleeper);
  return sleeper;
}

void Scheduler::Call(Sleeper& sleeper) {
  sleeper.called = true;
  asleep_.erase(std::find(asleep_.begin(), asleep_.end(), &sleeper));
  called_.push_back(&sleeper);
}

void Scheduler::WokeUp(Sleeper& sleeper) {
  std::erase(sleeper.called ? called_ : asleep_, &sleeper);
  spare_.push_back(&sleeper);
}

std::vector<Scheduler::Sleeper*> Scheduler::CallAll() {
  const std::vector<Sleeper*> called = asleep_;
  for (Sleeper* sleeper : called) Call(*sleeper);
  return called;
}

// Wakes the last one to sleep, whose caches are warm; those with a GPU first.
Scheduler::Sleeper* Scheduler::CallOne() {
  if (asleep_.empty()) return nullptr;
  Sleeper* best = nullptr;
  std::optional<bool> loads;  // true if there is something to load
  for (auto it = asleep_.rbegin(); it != asleep_.rend(); ++it) {
    Sleeper& sleeper = **it;
    if (sleeper.worker == nullptr) {
      if (!loads) loads = NextLoad().first != nullptr;
      if (!*loads) continue;
    } else if ((to_run_.lanes() & RunLanes(*sleeper.worker)) == 0 || to_run_.size() < sleeper.enough) {
      continue;
    }
    if (best == nullptr) best = &sleeper;
    if (sleeper.worker != nullptr && sleeper.worker->kind == BackendChoice::kCuda) {
      best = &sleeper;
      break;
    }
  }
  if (best != nullptr) Call(*best);
  return best;
}

// ---- the end of a task

void Scheduler::EndLocked(const Task& task, Time now) {
  const auto it = taken_.find(&task);
  if (it == taken_.end()) return;
  const std::shared_ptr<Batch> batch = std::move(it->second);
  taken_.erase(it);
  if (!waiters_.empty()) waiters_.erase(&task);
  if (batch->kind == WorkKind::kLoad) std::erase_if(loading_, [&](const Loading& l) { return l.task == &task; });
  if (--batch->left > 0) return;
  std::erase(running_, batch);
  if (batch->size == SizeClass::kGiant) {
    size_t& giants = batch->kind == WorkKind::kLoad ? giants_loading_ : giants_[batch->device];
    giants -= std::min<size_t>(1, giants);
  }
  // The worker of a giant may have waited for its client.
  if (batch->measurable && (batch->size != SizeClass::kGiant || batch->kind == WorkKind::kLoad)) {
    measured_.Observe(batch->kind, batch->size, batch->predicted_ms, MsBetween(batch->began, now));
  }
}

void Scheduler::Ended(const Task& task) {
  const Time now = Now();
  Sleeper* sleeper = nullptr;
  {
    const std::lock_guard lock(mutex_);
    EndLocked(task, now);
    sleeper = CallOne();  // after a giant, another one may run
    if (draining_ && IdleLocked()) drained_.notify_all();
  }
  Notify(sleeper);
}

void Scheduler::Ended(std::span<const std::shared_ptr<Task>> tasks) {
  const Time now = Now();
  Sleeper* sleeper = nullptr;
  {
    const std::lock_guard lock(mutex_);
    for (const std::shared_ptr<Task>& task : tasks) EndLocked(*task, now);
    sleeper = CallOne();
    if (draining_ && IdleLocked()) drained_.notify_all();
  }
  Notify(sleeper);
}

}  // namespace voxelpipe
