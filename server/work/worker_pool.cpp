#include "work/worker_pool.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// How long a refused client should wait: about one small job.
constexpr std::chrono::milliseconds kRetryDelay{200};

}  // namespace

WorkerPool::WorkerPool(int workers, size_t max_queue) : max_queue_(max_queue) {
  const int count = std::max(1, workers);
  threads_.reserve(size_t(count));
  for (int i = 0; i < count; ++i) threads_.emplace_back([this] { Work(); });
}

WorkerPool::~WorkerPool() {
  Drain();
  for (std::thread& thread : threads_) thread.join();
}

absl::StatusOr<WorkerPool::Ticket> WorkerPool::Submit(Job job) {
  Ticket ticket;
  {
    const std::lock_guard lock(mutex_);
    if (draining_) return absl::UnavailableError("the server is shutting down");
    // A job that an idle worker is about to take does not count as waiting.
    const size_t idle = threads_.size() - running_;
    if (queue_.size() >= max_queue_ + idle) {
      return BusyError(absl::StrCat("the queue is full: ", running_, " jobs run and ", queue_.size(), " wait"),
                       kRetryDelay);
    }
    ticket = next_ticket_++;
    queue_.push_back({ticket, std::move(job)});
  }
  changed_.notify_all();
  return ticket;
}

bool WorkerPool::Withdraw(Ticket ticket) {
  Job withdrawn;  // destroyed outside the lock: it may own a lot
  {
    const std::lock_guard lock(mutex_);
    const auto it = std::find_if(queue_.begin(), queue_.end(), [&](const Waiting& w) { return w.ticket == ticket; });
    if (it == queue_.end()) return false;
    withdrawn = std::move(it->job);
    queue_.erase(it);
  }
  changed_.notify_all();
  return true;
}

void WorkerPool::Drain() {
  std::unique_lock lock(mutex_);
  draining_ = true;
  changed_.notify_all();
  changed_.wait(lock, [this] { return queue_.empty() && running_ == 0; });
}

size_t WorkerPool::queued() const {
  const std::lock_guard lock(mutex_);
  return queue_.size();
}

size_t WorkerPool::running() const {
  const std::lock_guard lock(mutex_);
  return running_;
}

void WorkerPool::Work() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return draining_ || !queue_.empty(); });
    if (queue_.empty()) return;  // draining, and nothing left
    Job job = std::move(queue_.front().job);
    queue_.pop_front();
    ++running_;
    lock.unlock();
    job();
    job = nullptr;  // frees what it owns before the worker counts as idle
    lock.lock();
    --running_;
    changed_.notify_all();
  }
}

}  // namespace voxelpipe
