// The timed actions of the scheduler: queue time-outs, and raising aged tasks.
#include <utility>

#include "absl/strings/str_cat.h"
#include "observe/metrics.h"
#include "schedule/scheduler.h"

namespace voxelpipe {
namespace {

std::string Waited(const Task& task, JobContext::Clock::time_point now) {
  const auto ms = std::chrono::duration_cast<std::chrono::milliseconds>(now - task.traits.arrived).count();
  return absl::StrCat("waited ", ms, " ms in the queue");
}

}  // namespace

void Scheduler::RunTimers() {
  const Time now = Now();
  std::vector<std::shared_ptr<Task>> over;
  {
    const std::lock_guard lock(mutex_);
    while (const Task* task = deadlines_.PopDue(now)) over.push_back(Dequeue(*task));
    while (const Task* task = ages_.PopDue(now)) {
      // Not in the queue: it is being loaded, or was returned.
      if (to_run_.Raise(*task) || to_load_.Raise(*task)) ages_.Set(*task, now + options_.aging);
    }
    refusing_ += over.size();
  }
  if (options_.metrics != nullptr) options_.metrics->queue_timeouts.Increment(double(over.size()));
  Refuse(std::move(over), [&](const Task& task) {
    const TaskTraits& traits = task.traits;
    const bool call_over = traits.deadline && now >= *traits.deadline;
    return absl::DeadlineExceededError(
        absl::StrCat(call_over ? "the job's deadline has passed: it " : "the job's time in the queue is over: it ",
                     Waited(task, now)));
  });
}

void Scheduler::Refuse(std::vector<std::shared_ptr<Task>> tasks, const std::function<absl::Status(const Task&)>& why) {
  for (const std::shared_ptr<Task>& task : tasks) task->Refuse(why(*task));
  if (tasks.empty()) return;
  const std::lock_guard lock(mutex_);
  refusing_ -= tasks.size();
  if (draining_ && IdleLocked()) drained_.notify_all();
}

void Scheduler::ArmTimer(Time when) {
  if (timer_armed_ && *timer_armed_ <= when) return;
  timer_armed_ = when;
  timer_changed_.notify_one();
}

void Scheduler::LookAfterTimers() {
  std::unique_lock lock(mutex_);
  while (!stopped_) {
    std::optional<Time> next = deadlines_.Next();
    if (const std::optional<Time> age = ages_.Next(); age && (!next || *age < *next)) next = age;
    timer_armed_ = next;
    if (!next) {
      timer_changed_.wait(lock);
    } else if (*next > Now()) {
      timer_changed_.wait_until(lock, *next);
    } else {
      lock.unlock();
      RunTimers();
      lock.lock();
    }
  }
}

}  // namespace voxelpipe
