// The scheduler: chooses the next task, and the tasks of a batch.
//
// A task waits for a loader if its mesh must be loaded first, then for a worker of a device. FairQueue chooses the next
// one, AdmitTask decides if one more may wait, PredictCost and MeasuredCost predict its cost.
#pragma once

#include <array>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <unordered_map>
#include <vector>

#include "absl/status/status.h"
#include "job/request.h"
#include "schedule/admission.h"
#include "schedule/cost.h"
#include "schedule/device_choice.h"
#include "schedule/fair_queue.h"
#include "schedule/queue_timers.h"
#include "schedule/task.h"

namespace voxelpipe {

class Metrics;

struct SchedulerOptions {
  size_t max_queue = 1024;                 // waiting tasks
  uint64_t max_queue_bytes = 2ull << 30;   // of the waiting tasks
  double max_queue_ms = 600'000;           // predicted work of all of them, on one worker
  size_t max_batch_jobs = 1;               // tasks given to a device worker at once
  double max_batch_ms = 20;                // their total predicted work
  uint64_t max_batch_bytes = 64ull << 20;  // of their results
  // How long a worker that has just ended a batch waits for a fuller one. An idle worker takes a task immediately.
  std::chrono::microseconds batch_delay{0};
  std::chrono::milliseconds queue_timeout{0};  // for tasks without one; 0 = none
  std::chrono::milliseconds aging{10'000};     // a task that has waited this long is raised by one priority; 0 = never
  std::array<double, kPriorities> weights{16, 4, 1};
  double medium_ms = 20, giant_ms = 1000;  // predicted: lower bounds of the size classes
  size_t loaders = 1;                      // tasks that are loaded at the same time; see TakeLoad for exceptions
  uint64_t max_ready_bytes = 2ull << 30;   // of tasks that wait for a device worker: beyond it loading pauses
  Metrics* metrics = nullptr;              // must outlive the scheduler
  // For tests: the clock, and true if a thread serves the timers.
  std::function<JobContext::Clock::time_point()> now{};
  bool timer_thread = true;
};

struct QueueState {
  std::array<size_t, kPriorities> jobs{};  // waiting jobs
  uint64_t bytes = 0;                      // of the waiting jobs
  double ms = 0;                           // their predicted work
  size_t running = 0;                      // taken by loaders and workers
};

// Tasks from their submission to the end of their work. Thread-safe.
//
// Giants: all workers of a device but one may run them at the same time, so that a small task never waits for giants,
// unless the device has a single worker: then for at most one. The same holds for loaders.
//
// Loaders: a client without tasks that are being loaded, or are loaded and waiting, does not wait for loads of others.
// While there are threads, it gets one beyond SchedulerOptions::loaders.
class Scheduler {
 public:
  using Time = JobContext::Clock::time_point;

  // `workers`: tasks that run at the same time, without loaders.
  Scheduler(const SchedulerOptions& options, size_t workers);
  // After Drain and Stop, if tasks were submitted.
  ~Scheduler();
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;

  // Checks that a task with these traits would be admitted now: for callers that are about to receive much data for it.
  // Errors: those of Submit.
  absl::Status Admit(const TaskTraits& traits) const;
  // True if no task, with any traits, is admitted now; then with the error that Admit would return. Cheap. A task whose
  // mesh is being loaded keeps its place, because it returns to wait for a worker.
  bool IsFull() const;
  absl::Status FullError() const;
  // Admits a task. It ends with Task::Refuse and DEADLINE_EXCEEDED if its deadline or queue time-out passes before a
  // worker takes it. Errors: see AdmitTask; UNAVAILABLE after Drain began.
  absl::Status Submit(std::shared_ptr<Task> task);
  // The clients that wait for a shared task, and the latest of their deadlines.
  struct Waiters {
    std::vector<FairQueue::Stand> stands;  // at least one, all different; the best priority first
    std::optional<Time> deadline;          // the latest; none: a client has no deadline
    std::optional<Time> queue_deadline;    // the same for their queue time-outs
  };
  // Gives a submitted, unfinished task the best place, priority and deadline of all its waiters. No effect if a device
  // worker runs it.
  void SetWaiters(Task& task, Waiters waiters);
  // The queue deadline of a task submitted now without one of its own; none: no limit.
  std::optional<Time> QueueDeadline() const;
  // Returns a task from Take... to the queue: after loading, or because its worker failed; the latter goes first. Never
  // refused.
  void Resubmit(std::shared_ptr<Task> task);
  // Removes a waiting task: true if it was waiting; then none of its functions is called any more.
  bool Withdraw(const Task& task);
  // For loaders: a task to load. Blocks; null when the scheduler was stopped.
  std::shared_ptr<Task> TakeLoad();
  // The same without blocking: null also if nothing may be loaded now.
  std::shared_ptr<Task> TryTakeLoad();
  // Replaces SchedulerOptions::loaders.
  void SetLoaders(size_t loaders);
  // For device workers: tasks to run as a batch, at least one, all loaded. Blocks; empty when the scheduler was
  // stopped, or while the device does not serve.
  std::vector<std::shared_ptr<Task>> TakeBatch(const WorkerTraits& worker);
  // The same without blocking: empty also if there is nothing for this worker now.
  std::vector<std::shared_ptr<Task>> TryTakeBatch(const WorkerTraits& worker);
  // Reports the end of tasks from Take...; several at once cost less.
  void Ended(const Task& task);
  void Ended(std::span<const std::shared_ptr<Task>> tasks);

  // Sets the serving devices: before their first TakeBatch, and at every change. `workers` 0: it takes no tasks until
  // changed.
  void SetDevice(const WorkerTraits& device, size_t workers);
  // Removes all waiting tasks that no serving device may run. They pass to the caller and count as not running.
  std::vector<std::shared_ptr<Task>> TakeStranded();
  // True if a serving device may run such a task.
  bool IsServed(const TaskTraits& task) const;

  // Refuses new tasks and returns when all accepted ones have ended.
  void Drain();
  // Makes every Take... return nothing. After Drain.
  void Stop();

  // Ends tasks past their queue time-out and raises aged ones. Called by the timer thread; by tests directly.
  void RunTimers();

  size_t queued() const;
  size_t running() const;
  size_t idle() const;  // threads waiting for work
  QueueState state() const;
  double waiting_ms() const;  // predicted work of the waiting tasks
  uint64_t waiting_bytes() const;

 private:
  struct Batch {  // tasks taken as one batch
    WorkKind kind = WorkKind::kCpu;
    SizeClass size = SizeClass::kSmall;
    std::string device;  // empty for a loader
    double predicted_ms = 0;
    double expected_ms = 0;  // the same, corrected by measurements
    Time began;
    size_t left = 0;
    bool measurable = true;  // its time has no waiting in it
  };
  // A task that a loader has taken, with its values at that time, so that no other task takes its place. The task
  // itself may change.
  struct Loading {
    const Task* task = nullptr;
    std::string client;
    uint64_t bytes = 0;
    double run_ms = 0;
  };
  // A thread waiting for work. Freed only with the scheduler, so that it can be notified without the lock.
  struct Sleeper {
    std::condition_variable wake;
    const WorkerTraits* worker = nullptr;  // null: a loader
    size_t enough = 1;                     // tasks that it waits for
    bool called = false;
  };
  Time Now() const { return options_.now ? options_.now() : JobContext::Clock::now(); }
  SizeClass ClassOf(double ms, uint64_t output_bytes) const;
  double LoadMs(const TaskTraits& traits) const;
  double RunMs(const TaskTraits& traits) const;
  double RunMsOn(const TaskTraits& traits, BackendChoice kind) const;
  // A spinning lock: workers hold it for a microsecond or two, less than sleeping and waking take.
  std::unique_lock<std::mutex> LockShortly() const;
  // The number of waiting tasks, including those being loaded; of running tasks, without these.
  size_t PlacesTakenLocked() const { return QueuedLocked() + loading_.size(); }
  size_t RunningLocked() const { return taken_.size() - loading_.size(); }
  Backlog BacklogLocked() const;
  AdmissionAnswer AdmissionLocked(const TaskTraits& traits, Time now) const;
  void CountRefused(const AdmissionAnswer& answer) const;

  void Enqueue(std::shared_ptr<Task> task, Time now);
  void SetTimesLocked(const Task& task);
  std::shared_ptr<Task> Dequeue(const Task& task);
  void Forget(const Task& task);
  size_t LaneOf(const TaskTraits& traits) const;
  bool KindServes(BackendChoice kind) const;
  const ServingDevice* Serving(const std::string& device) const;
  std::vector<Sleeper*> CallAll();
  // Lanes from which the worker may take now. `look_again`, if given: the time at which that may change without an
  // event.
  FairQueue::Lanes RunLanes(const WorkerTraits& worker, std::optional<Time>* look_again = nullptr) const;
  // The workers of this kind that may run the task; the caller sets `waiting_ms`.
  KindOutlook Outlook(const TaskTraits& task, BackendChoice kind, Time now) const;
  // True if the worker leaves such a task, of which `waiting` are waiting, to another kind.
  bool Leaves(const TaskTraits& task, const WorkerTraits& worker, size_t waiting, Time now,
              std::optional<Time>* look_again) const;
  // The tasks that may be loaded now.
  struct LoadChoice {
    FairQueue::Lanes lanes = 0;
    FairQueue::Skip skip;  // clients without tasks that may be loaded
    size_t lane = 0;       // of its first
    const Task* first = nullptr;
  };
  LoadChoice NextLoad() const;
  std::shared_ptr<Task> TakeLoadLocked();

  std::vector<std::shared_ptr<Task>> FormBatch(const WorkerTraits& worker, bool may_delay, Time now,
                                               std::optional<Time>& come_again, std::optional<Time>& look_again);
  void Take(const std::shared_ptr<Task>& task, const std::shared_ptr<Batch>& batch);
  void TellTaken(std::span<const std::shared_ptr<Task>> batch, Time now) const;
  void EndLocked(const Task& task, Time now);
  Sleeper& Sleep(const WorkerTraits* worker, size_t enough);
  void Call(Sleeper& sleeper);
  void WokeUp(Sleeper& sleeper);
  // Chooses a sleeping thread that has work now, if there is one; the caller notifies it after unlocking.
  Sleeper* CallOne();
  static void Notify(Sleeper* sleeper) {
    if (sleeper != nullptr) sleeper->wake.notify_one();
  }
  void ArmTimer(Time when);
  void LookAfterTimers();
  void Refuse(std::vector<std::shared_ptr<Task>> tasks, const std::function<absl::Status(const Task&)>& why);
  size_t QueuedLocked() const { return to_load_.size() + to_run_.size() + again_.size(); }
  bool IdleLocked() const { return QueuedLocked() == 0 && taken_.empty() && refusing_ == 0; }

  const SchedulerOptions options_;
  const size_t workers_;

  mutable std::mutex mutex_;
  FairQueue to_load_, to_run_;
  std::list<std::shared_ptr<Task>> again_;            // tasks whose worker failed
  std::unordered_map<const Task*, Waiters> waiters_;  // of tasks with SetWaiters
  std::unordered_map<const Task*, std::shared_ptr<Batch>> taken_;
  std::vector<Loading> loading_;                  // of taken_, at most one for each loader
  std::vector<std::shared_ptr<Batch>> running_;   // of device workers
  uint64_t waiting_bytes_ = 0, ready_bytes_ = 0;  // the latter of to_run_ only
  std::optional<Time> ready_since_;               // to_run_ is not empty
  MeasuredCost measured_;
  std::vector<ServingDevice> serving_;
  std::atomic<uint32_t> serving_kinds_{0};  // of these, a bit each; read without the lock
  std::map<std::string, size_t> giants_;    // running, per device
  size_t loaders_, giants_loading_ = 0;
  size_t refusing_ = 0;
  bool draining_ = false, stopped_ = false;
  std::condition_variable drained_;

  std::vector<std::unique_ptr<Sleeper>> sleepers_;
  std::vector<Sleeper*> asleep_;  // the last one to sleep is at the end
  std::vector<Sleeper*> called_;  // notified, not yet running
  std::vector<Sleeper*> spare_;

  QueueTimers deadlines_, ages_;
  std::condition_variable timer_changed_;
  std::optional<Time> timer_armed_;  // when the timer thread wakes
  std::thread timer_;
};

}  // namespace voxelpipe
