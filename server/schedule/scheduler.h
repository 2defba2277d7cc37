// Which task runs next, and which ones together.
//
// A task waits for a loader where its mesh must be read first, then for a worker of a device. FairQueue chooses the
// next one; whether one more may wait, AdmitTask; what it will take, PredictCost and MeasuredCost.
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
  size_t max_queue = 1024;                 // tasks that wait
  uint64_t max_queue_bytes = 2ull << 30;   // that they hold
  double max_queue_ms = 600'000;           // predicted work of all of them, on one worker
  size_t max_batch_jobs = 1;               // tasks given to a device worker at once
  double max_batch_ms = 20;                // predicted work of these together
  uint64_t max_batch_bytes = 64ull << 20;  // of their results
  // How long a worker that has just ended a batch waits for a fuller one. An idle worker takes a task at once.
  std::chrono::microseconds batch_delay{0};
  std::chrono::milliseconds queue_timeout{0};  // of tasks that set none; 0 = none
  std::chrono::milliseconds aging{10'000};     // a task that has waited so long rises by one priority; 0 = never
  std::array<double, kPriorities> weights{16, 4, 1};
  double medium_ms = 20, giant_ms = 1000;  // predicted, from where on a task counts as such
  size_t loaders = 1;                      // tasks that are loaded at the same time, but see TakeLoad
  uint64_t max_ready_bytes = 2ull << 30;   // of tasks that wait for a device worker: beyond it none is loaded
  Metrics* metrics = nullptr;              // must outlive the scheduler
  // For tests: the time, and whether a thread looks after the timers.
  std::function<JobContext::Clock::time_point()> now{};
  bool timer_thread = true;
};

struct QueueState {
  std::array<size_t, kPriorities> jobs{};  // that wait
  uint64_t bytes = 0;                      // that they hold
  double ms = 0;                           // predicted work of them
  size_t running = 0;                      // in the hands of loaders and workers
};

// Tasks from their submission to the end of their work. Thread-safe.
//
// Giants: of the workers of a device, all but one may run them at the same time, so that a small task never waits for
// giants to end, unless the device has a single worker: then at most one is before it. The same holds for loaders.
//
// Loaders: a client of which nothing is being loaded, and nothing waits that was, does not wait for those of others.
// While there are threads for it, it gets one beyond SchedulerOptions::loaders.
class Scheduler {
 public:
  using Time = JobContext::Clock::time_point;

  // `workers`: tasks that are worked on at the same time, loaders not counted.
  Scheduler(const SchedulerOptions& options, size_t workers);
  // After Drain and Stop, if tasks were submitted.
  ~Scheduler();
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;

  // Checks that a task with these traits would be admitted now: for callers that are about to receive a lot for it.
  // Errors: those of Submit.
  absl::Status Admit(const TaskTraits& traits) const;
  // True if there is no place for any task now, whatever its traits; and then what Admit would say to all. Cheap.
  // A task whose mesh is being loaded keeps its place, since it comes back to wait for a worker.
  bool IsFull() const;
  absl::Status FullError() const;
  // Takes a task in. From here on it ends by Task::Refuse with DEADLINE_EXCEEDED if its deadline, or its time in the
  // queue, is over before a worker has it. Errors: see AdmitTask; UNAVAILABLE after Drain began.
  absl::Status Submit(std::shared_ptr<Task> task);
  // Who waits for a task that several wait for, and until when the last of them does.
  struct Waiters {
    std::vector<FairQueue::Stand> stands;  // at least one, no two equal; the best priority first
    std::optional<Time> deadline;          // the latest; none: one waits without
    std::optional<Time> queue_deadline;    // the same of their times in the queue
  };
  // Gives a task that was submitted and has not ended the best place, priority and deadline of all who wait for it.
  // Nothing happens to one that a device worker has.
  void SetWaiters(Task& task, Waiters waiters);
  // Until when a task that is submitted now may wait in the queue, if it sets none; none: as long as it takes.
  std::optional<Time> QueueDeadline() const;
  // Gives back a task that came from Take..., to be taken again: loaded meanwhile, or because its worker failed; the
  // latter goes before all others. Never refused.
  void Resubmit(std::shared_ptr<Task> task);
  // Takes a task that still waits out: true if it was there, and then nothing of it is called any more.
  bool Withdraw(const Task& task);
  // For loaders: a task that is not loaded. Blocks; null when the scheduler was stopped.
  std::shared_ptr<Task> TakeLoad();
  // The same without waiting: null, too, where nothing may be loaded now.
  std::shared_ptr<Task> TryTakeLoad();
  // In place of SchedulerOptions::loaders from now on.
  void SetLoaders(size_t loaders);
  // For device workers: tasks to run together, at least one, all loaded. Blocks; empty when the scheduler was stopped,
  // or while the device does not serve.
  std::vector<std::shared_ptr<Task>> TakeBatch(const WorkerTraits& worker);
  // The same without waiting: empty, too, where there is nothing for this worker now.
  std::vector<std::shared_ptr<Task>> TryTakeBatch(const WorkerTraits& worker);
  // A task that came from Take... has ended; several at once cost less.
  void Ended(const Task& task);
  void Ended(std::span<const std::shared_ptr<Task>> tasks);

  // Which devices serve: before their first TakeBatch, and at every change. `workers` 0: it takes nothing until set
  // otherwise.
  void SetDevice(const WorkerTraits& device, size_t workers);
  // Takes out all tasks that wait for a device and that none may have that serves now. They are the caller's, and not
  // worked on.
  std::vector<std::shared_ptr<Task>> TakeStranded();
  // True if a device serves that may have such a task.
  bool IsServed(const TaskTraits& task) const;

  // Refuses new tasks and returns when all accepted ones have ended.
  void Drain();
  // Makes every Take... return nothing. After Drain.
  void Stop();

  // Ends what has waited too long and raises what has waited long. The timer thread does it; in tests, by hand.
  void RunTimers();

  size_t queued() const;
  size_t running() const;
  size_t idle() const;  // threads that wait for work
  QueueState state() const;
  double waiting_ms() const;  // predicted work of what waits
  uint64_t waiting_bytes() const;

 private:
  struct Batch {  // tasks that were taken together
    WorkKind kind = WorkKind::kCpu;
    SizeClass size = SizeClass::kSmall;
    std::string device;  // empty for a loader's
    double predicted_ms = 0;
    double expected_ms = 0;  // the same, as corrected by what was measured
    Time began;
    size_t left = 0;
    bool measurable = true;  // its time is the work's alone
  };
  // A task in a loader's hands: what it held when it was taken, so that no other task takes its place meanwhile. The
  // task itself may change.
  struct Loading {
    const Task* task = nullptr;
    std::string client;
    uint64_t bytes = 0;
    double run_ms = 0;
  };
  // A thread that waits for work. Never freed before the scheduler, so that it can be notified without the lock.
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
  // Workers hold the lock for a microsecond or two at a time: to sleep for it, and to be woken, takes longer.
  std::unique_lock<std::mutex> LockShortly() const;
  // Tasks that wait, those included that are being loaded; those that run, without these.
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
  // Lanes from which the worker may take now. `look_again`, if given: when that may be different though nothing happens
  // until then.
  FairQueue::Lanes RunLanes(const WorkerTraits& worker, std::optional<Time>* look_again = nullptr) const;
  // Of the devices of this kind that may have the task; `waiting_ms` is left to the caller.
  KindOutlook Outlook(const TaskTraits& task, BackendChoice kind, Time now) const;
  // True if the worker leaves such a task, of which `waiting` wait, to another kind.
  bool Leaves(const TaskTraits& task, const WorkerTraits& worker, size_t waiting, Time now,
              std::optional<Time>* look_again) const;
  // What may be loaded now.
  struct LoadChoice {
    FairQueue::Lanes lanes = 0;
    FairQueue::Skip skip;  // clients of which nothing may
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
  // Calls one thread that can do something now, if there is one; the caller notifies it when the lock is open.
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
  std::list<std::shared_ptr<Task>> again_;            // whose worker failed
  std::unordered_map<const Task*, Waiters> waiters_;  // of tasks that SetWaiters was called for
  std::unordered_map<const Task*, std::shared_ptr<Batch>> taken_;
  std::vector<Loading> loading_;                  // of taken_, at most one for each loader
  std::vector<std::shared_ptr<Batch>> running_;   // of device workers
  uint64_t waiting_bytes_ = 0, ready_bytes_ = 0;  // the latter of to_run_ alone
  std::optional<Time> ready_since_;               // to_run_ is not empty
  MeasuredCost measured_;
  std::vector<ServingDevice> serving_;
  std::atomic<uint32_t> serving_kinds_{0};  // of these, a bit each; read without the lock
  std::map<std::string, size_t> giants_;    // that run, of each device
  size_t loaders_, giants_loading_ = 0;
  size_t refusing_ = 0;
  bool draining_ = false, stopped_ = false;
  std::condition_variable drained_;

  std::vector<std::unique_ptr<Sleeper>> sleepers_;
  std::vector<Sleeper*> asleep_;  // who slept last is at the end
  std::vector<Sleeper*> called_;  // on their way
  std::vector<Sleeper*> spare_;

  QueueTimers deadlines_, ages_;
  std::condition_variable timer_changed_;
  std::optional<Time> timer_armed_;  // when the timer thread wakes
  std::thread timer_;
};

}  // namespace voxelpipe
