#include "work/scheduler.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// How long a refused client should wait: about one small job.
constexpr std::chrono::milliseconds kRetryDelay{200};

}  // namespace

Scheduler::Scheduler(const SchedulerOptions& options, size_t workers) : options_(options), workers_(workers) {}

Scheduler::~Scheduler() = default;

absl::Status Scheduler::Submit(std::shared_ptr<Task> task) {
  {
    const std::lock_guard lock(mutex_);
    if (draining_) return absl::UnavailableError("the server is shutting down");
    const size_t waiting = to_load_.size() + to_run_.size();
    // A task that an idle worker is about to take does not count as waiting.
    if (waiting + running_ >= options_.max_queue + std::max(workers_, running_)) {
      return BusyError(absl::StrCat("the queue is full: ", running_, " jobs run and ", waiting, " wait"), kRetryDelay);
    }
    (task->loaded() ? to_run_ : to_load_).push_back(std::move(task));
  }
  changed_.notify_all();
  return absl::OkStatus();
}

void Scheduler::Resubmit(std::shared_ptr<Task> task) {
  {
    const std::lock_guard lock(mutex_);
    --running_;
    (task->loaded() ? to_run_ : to_load_).push_front(std::move(task));
  }
  changed_.notify_all();
}

bool Scheduler::Withdraw(const Task& task) {
  std::shared_ptr<Task> withdrawn;  // destroyed outside the lock: it may own a lot
  {
    const std::lock_guard lock(mutex_);
    for (auto* queue : {&to_load_, &to_run_}) {
      const auto it = std::find_if(queue->begin(), queue->end(), [&](const auto& t) { return t.get() == &task; });
      if (it == queue->end()) continue;
      withdrawn = std::move(*it);
      queue->erase(it);
      break;
    }
  }
  if (!withdrawn) return false;
  changed_.notify_all();
  return true;
}

std::shared_ptr<Task> Scheduler::TakeLoad() {
  std::unique_lock lock(mutex_);
  changed_.wait(lock, [this] { return stopped_ || !to_load_.empty(); });
  if (to_load_.empty()) return nullptr;
  std::shared_ptr<Task> task = std::move(to_load_.front());
  to_load_.pop_front();
  ++running_;
  return task;
}

std::vector<std::shared_ptr<Task>> Scheduler::TakeBatch(const WorkerTraits& worker) {
  std::unique_lock lock(mutex_);
  std::vector<std::shared_ptr<Task>> batch;
  changed_.wait(lock, [&] {
    if (!Serves(worker.device)) return true;
    for (auto it = to_run_.begin(); it != to_run_.end() && batch.size() < options_.max_batch_jobs;) {
      const TaskTraits& task = (*it)->traits;
      if (!MayHave(task, worker, serving_) ||
          LeavesToGpus(task, worker, serving_, to_run_.size() + batch.size(), options_.max_batch_jobs)) {
        ++it;
        continue;
      }
      batch.push_back(std::move(*it));
      it = to_run_.erase(it);
    }
    return stopped_ || !batch.empty();
  });
  running_ += batch.size();
  return batch;
}

void Scheduler::Ended(const Task& /*task*/) {
  {
    const std::lock_guard lock(mutex_);
    --running_;
  }
  changed_.notify_all();
}

bool Scheduler::Serves(const std::string& device) const {
  return std::any_of(serving_.begin(), serving_.end(), [&](const auto& d) { return d.traits.device == device; });
}

void Scheduler::SetDevice(const WorkerTraits& device, size_t workers) {
  {
    const std::lock_guard lock(mutex_);
    std::erase_if(serving_, [&](const ServingDevice& d) { return d.traits.device == device.device; });
    if (workers > 0) serving_.push_back({device, workers});
  }
  changed_.notify_all();
}

std::vector<std::shared_ptr<Task>> Scheduler::TakeStranded() {
  std::vector<std::shared_ptr<Task>> stranded;
  {
    const std::lock_guard lock(mutex_);
    for (auto it = to_run_.begin(); it != to_run_.end();) {
      if (AnyMayHave((*it)->traits, serving_)) {
        ++it;
        continue;
      }
      stranded.push_back(std::move(*it));
      it = to_run_.erase(it);
    }
  }
  if (!stranded.empty()) changed_.notify_all();
  return stranded;
}

bool Scheduler::IsServed(const TaskTraits& task) const {
  const std::lock_guard lock(mutex_);
  return AnyMayHave(task, serving_);
}

void Scheduler::Drain() {
  std::unique_lock lock(mutex_);
  draining_ = true;
  changed_.wait(lock, [this] { return to_load_.empty() && to_run_.empty() && running_ == 0; });
}

void Scheduler::Stop() {
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  changed_.notify_all();
}

size_t Scheduler::queued() const {
  const std::lock_guard lock(mutex_);
  return to_load_.size() + to_run_.size();
}

size_t Scheduler::running() const {
  const std::lock_guard lock(mutex_);
  return running_;
}

}  // namespace voxelpipe
