#include "schedule/scheduler.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "observe/metrics.h"
#include "schedule/scheduler_lanes.h"

namespace voxelpipe {
namespace {

// A job with a larger result is a giant, however fast it runs: its result is streamed slab by slab, while its worker
// waits for the client.
constexpr uint64_t kGiantBytes = 512ull << 20;

void Relax() {
#if defined(__x86_64__)
  __builtin_ia32_pause();
#endif
}

}  // namespace

Scheduler::Scheduler(const SchedulerOptions& options, size_t workers)
    : options_(options),
      workers_(std::max<size_t>(1, workers)),
      to_load_(options.weights),
      to_run_(options.weights),
      loaders_(std::max<size_t>(1, options.loaders)) {
  if (options.timer_thread) timer_ = std::thread([this] { LookAfterTimers(); });
}

Scheduler::~Scheduler() {
  Stop();
  if (timer_.joinable()) timer_.join();
}

// ---- cost of tasks

SizeClass Scheduler::ClassOf(double ms, uint64_t output_bytes) const {
  if (ms >= options_.giant_ms || output_bytes >= kGiantBytes) return SizeClass::kGiant;
  return ms >= options_.medium_ms ? SizeClass::kMedium : SizeClass::kSmall;
}

double Scheduler::LoadMs(const TaskTraits& traits) const {
  return traits.cost.load_ms * measured_.Ratio(WorkKind::kLoad, ClassOf(traits.cost.load_ms, 0));
}

// For a device worker, which loads small meshes itself.
double Scheduler::RunMs(const TaskTraits& traits) const {
  const bool cuda = traits.backend != BackendChoice::kCpu && KindServes(BackendChoice::kCuda);
  return RunMsOn(traits, cuda ? BackendChoice::kCuda : BackendChoice::kCpu);
}

double Scheduler::RunMsOn(const TaskTraits& traits, BackendChoice kind) const {
  const double ms = traits.cost.run_ms + traits.cost.load_ms;
  const WorkKind work = kind == BackendChoice::kCuda ? WorkKind::kCuda : WorkKind::kCpu;
  return ms * measured_.Ratio(work, ClassOf(ms, traits.cost.output_bytes));
}

// ---- submission

Backlog Scheduler::BacklogLocked() const {
  Backlog backlog;
  backlog.jobs = PlacesTakenLocked();
  backlog.bytes = waiting_bytes_;
  backlog.ms = to_run_.waiting_ms() + to_load_.waiting_ms();
  for (const Loading& loading : loading_) {
    backlog.bytes += loading.bytes;
    backlog.ms += loading.run_ms;
  }
  backlog.running = RunningLocked();
  backlog.workers = workers_;
  return backlog;
}

AdmissionAnswer Scheduler::AdmissionLocked(const TaskTraits& traits, Time now) const {
  const double ms = RunMs(traits);
  Backlog backlog = BacklogLocked();
  backlog.client_jobs = to_run_.WaitingOf(traits.client) + to_load_.WaitingOf(traits.client);
  for (const Loading& loading : loading_) backlog.client_jobs += loading.client == traits.client ? 1 : 0;
  backlog.ahead_ms = to_run_.AheadMs(traits.priority, traits.client, ms);
  return AdmitTask({options_.max_queue, options_.max_queue_bytes, options_.max_queue_ms}, backlog, traits, ms, now);
}

void Scheduler::CountRefused(const AdmissionAnswer& answer) const {
  if (options_.metrics == nullptr) return;
  switch (answer.why) {
    case Refused::kNo: return;
    case Refused::kJobs: return options_.metrics->Turned(Admission::kJobs).Increment();
    case Refused::kBytes: return options_.metrics->Turned(Admission::kBytes).Increment();
    case Refused::kTime: return options_.metrics->Turned(Admission::kTime).Increment();
    case Refused::kDeadline: return options_.metrics->Turned(Admission::kDeadline).Increment();
  }
}

absl::Status Scheduler::Admit(const TaskTraits& traits) const {
  AdmissionAnswer answer;
  {
    const std::lock_guard lock(mutex_);
    if (draining_) return absl::UnavailableError("the server is shutting down");
    answer = AdmissionLocked(traits, Now());
  }
  CountRefused(answer);
  return std::move(answer.status);
}

std::unique_lock<std::mutex> Scheduler::LockShortly() const {
  constexpr int kTries = 100;  // some microseconds
  std::unique_lock lock(mutex_, std::try_to_lock);
  for (int i = 0; i < kTries && !lock.owns_lock(); ++i) {
    Relax();
    lock.try_lock();
  }
  if (!lock.owns_lock()) lock.lock();
  return lock;
}

bool Scheduler::IsFull() const {
  const std::unique_lock lock = LockShortly();
  return !draining_ && PlacesTakenLocked() >= PlacesFor(options_.max_queue, RunningLocked(), workers_);
}

absl::Status Scheduler::FullError() const {
  const std::lock_guard lock(mutex_);
  return QueueFullError(BacklogLocked());
}

absl::Status Scheduler::Submit(std::shared_ptr<Task> task) {
  task->Weigh();
  const Time now = Now();
  TaskTraits& traits = task->traits;
  traits.arrived = now;
  if (!traits.queue_timeout && options_.queue_timeout.count() > 0) traits.queue_timeout = options_.queue_timeout;
  if (traits.queue_timeout && traits.queue_timeout->count() > 0) traits.queue_deadline = now + *traits.queue_timeout;
  AdmissionAnswer answer;
  Sleeper* sleeper = nullptr;
  {
    const std::unique_lock lock = LockShortly();
    if (draining_) return absl::UnavailableError("the server is shutting down");
    answer = AdmissionLocked(traits, now);
    if (answer.why == Refused::kNo) {
      Enqueue(std::move(task), now);
      sleeper = CallOne();
    }
  }
  Notify(sleeper);
  CountRefused(answer);
  return std::move(answer.status);
}

std::optional<Scheduler::Time> Scheduler::QueueDeadline() const {
  if (options_.queue_timeout.count() <= 0) return std::nullopt;
  return Now() + options_.queue_timeout;
}

void Scheduler::SetWaiters(Task& task, Waiters waiters) {
  const std::lock_guard lock(mutex_);
  const auto taken = taken_.find(&task);
  if (taken != taken_.end()) {  // its loader owns its traits
    if (taken->second->kind == WorkKind::kLoad) waiters_[&task] = std::move(waiters);
    return;
  }
  const bool queued = to_run_.SetStands(task, waiters.stands) || to_load_.SetStands(task, waiters.stands);
  const bool again = std::any_of(again_.begin(), again_.end(), [&](const auto& t) { return t.get() == &task; });
  if (!queued && !again) return;
  TaskTraits& traits = task.traits;
  const bool aged = traits.priority != Priority::kHigh;
  traits.client = waiters.stands.front().client;
  traits.priority = waiters.stands.front().priority;
  traits.deadline = waiters.deadline;
  if (queued) traits.queue_deadline = waiters.queue_deadline;  // does not apply to a task whose worker failed
  const Time now = Now();
  SetTimesLocked(task);
  if (!aged && queued && options_.aging.count() > 0 && traits.priority != Priority::kHigh) {
    ages_.Set(task, now + options_.aging);
    ArmTimer(now + options_.aging);
  }
  waiters_[&task] = std::move(waiters);
}

void Scheduler::Resubmit(std::shared_ptr<Task> task) {
  task->Weigh();
  const Time now = Now();
  std::vector<Sleeper*> called;
  {
    const std::lock_guard lock(mutex_);
    auto joined = waiters_.extract(task.get());  // it has not ended
    const auto it = taken_.find(task.get());
    const bool was_loading = it != taken_.end() && it->second->kind == WorkKind::kLoad;
    if (was_loading && !joined.empty()) {
      const Waiters& waiters = joined.mapped();
      task->traits.client = waiters.stands.front().client;
      task->traits.priority = waiters.stands.front().priority;
      task->traits.deadline = waiters.deadline;
      task->traits.queue_deadline = waiters.queue_deadline;
    }
    if (was_loading && task->traits.queue_deadline) *task->traits.queue_deadline += now - it->second->began;
    EndLocked(*task, now);
    if (was_loading) {
      const Task& waiting = *task;
      Enqueue(std::move(task), now);
      if (!joined.empty()) {
        if (!to_run_.SetStands(waiting, joined.mapped().stands)) to_load_.SetStands(waiting, joined.mapped().stands);
        waiters_.insert(std::move(joined));
      }
      called.push_back(CallOne());
    } else {
      // Its queue time-out has passed, its deadline has not.
      task->traits.queue_deadline.reset();
      if (task->traits.deadline) {
        deadlines_.Set(*task, *task->traits.deadline);
        ArmTimer(*task->traits.deadline);
      }
      waiting_bytes_ += task->traits.cost.held_bytes;
      again_.push_back(std::move(task));
      called = CallAll();  // not every worker may run it
    }
  }
  for (Sleeper* sleeper : called) Notify(sleeper);
}

size_t Scheduler::LaneOf(const TaskTraits& traits) const {
  const double ms = traits.cost.run_ms + traits.cost.load_ms;
  const bool free = traits.backend != BackendChoice::kAuto && traits.fallback && !KindServes(traits.backend);
  return LaneFor(free ? BackendChoice::kAuto : traits.backend, ClassOf(ms, traits.cost.output_bytes));
}

// The time at which the task is refused if no worker has taken it.
void Scheduler::SetTimesLocked(const Task& task) {
  const TaskTraits& traits = task.traits;
  std::optional<Time> by = traits.deadline;
  if (traits.queue_deadline) by = by ? std::min(*by, *traits.queue_deadline) : *traits.queue_deadline;
  if (by) {
    deadlines_.Set(task, *by);
    ArmTimer(*by);
  } else {
    deadlines_.Clear(task);
  }
}

void Scheduler::Enqueue(std::shared_ptr<Task> task, Time now) {
  const TaskTraits& traits = task->traits;
  const Task& waiting = *task;
  waiting_bytes_ += traits.cost.held_bytes;
  SetTimesLocked(waiting);
  if (options_.aging.count() > 0 && traits.priority != Priority::kHigh) {
    ages_.Set(waiting, now + options_.aging);
    ArmTimer(now + options_.aging);
  }
  if (!task->loaded()) {
    const size_t lane = LaneFor(BackendChoice::kAuto, ClassOf(traits.cost.load_ms, 0));
    to_load_.Push(std::move(task), lane, traits.priority, traits.client, LoadMs(traits));
    return;
  }
  if (to_run_.size() == 0) ready_since_ = now;
  ready_bytes_ += traits.cost.held_bytes;
  to_run_.Push(std::move(task), LaneOf(traits), traits.priority, traits.client, RunMs(traits));
}

// The common part of every removal from the queue.
void Scheduler::Forget(const Task& task) {
  waiting_bytes_ -= std::min(waiting_bytes_, task.traits.cost.held_bytes);
  deadlines_.Clear(task);
  ages_.Clear(task);
}

std::shared_ptr<Task> Scheduler::Dequeue(const Task& task) {
  std::shared_ptr<Task> found = to_run_.Remove(task);
  if (found) ready_bytes_ -= std::min(ready_bytes_, task.traits.cost.held_bytes);
  if (!found) found = to_load_.Remove(task);
  if (!found) {
    const auto it = std::find_if(again_.begin(), again_.end(), [&](const auto& t) { return t.get() == &task; });
    if (it == again_.end()) return nullptr;
    found = std::move(*it);
    again_.erase(it);
  }
  Forget(task);
  if (!waiters_.empty()) waiters_.erase(&task);
  return found;
}

bool Scheduler::Withdraw(const Task& task) {
  std::shared_ptr<Task> withdrawn;  // destroyed outside the lock, because it may own much memory
  const std::lock_guard lock(mutex_);
  withdrawn = Dequeue(task);
  if (withdrawn && draining_ && IdleLocked()) drained_.notify_all();
  return withdrawn != nullptr;
}

// ---- the end

void Scheduler::Drain() {
  std::unique_lock lock(mutex_);
  draining_ = true;
  drained_.wait(lock, [this] { return IdleLocked(); });
}

void Scheduler::Stop() {
  const std::lock_guard lock(mutex_);
  stopped_ = true;
  for (const auto& sleeper : sleepers_) sleeper->wake.notify_all();
  timer_changed_.notify_all();
}

size_t Scheduler::queued() const {
  const std::lock_guard lock(mutex_);
  return QueuedLocked();
}

size_t Scheduler::running() const {
  const std::lock_guard lock(mutex_);
  return taken_.size();
}

size_t Scheduler::idle() const {
  const std::lock_guard lock(mutex_);
  return asleep_.size();
}

QueueState Scheduler::state() const {
  const std::lock_guard lock(mutex_);
  QueueState state;
  for (size_t p = 0; p < kPriorities; ++p) state.jobs[p] = to_load_.size(Priority(p)) + to_run_.size(Priority(p));
  for (const std::shared_ptr<Task>& task : again_) ++state.jobs[size_t(task->traits.priority)];
  state.bytes = waiting_bytes_;
  state.ms = to_run_.waiting_ms() + to_load_.waiting_ms();
  state.running = taken_.size();
  return state;
}

double Scheduler::waiting_ms() const {
  const std::lock_guard lock(mutex_);
  return to_run_.waiting_ms() + to_load_.waiting_ms();
}

uint64_t Scheduler::waiting_bytes() const {
  const std::lock_guard lock(mutex_);
  return waiting_bytes_;
}

}  // namespace voxelpipe
