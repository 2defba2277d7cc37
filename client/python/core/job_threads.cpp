#include "job_threads.h"

#include <pthread.h>

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>

namespace voxelpipe {
namespace {

struct Task {
  std::function<void()> work, done;
};

class JobThreads {
 public:
  void Run(Task task) {
    const std::lock_guard lock(mutex_);
    waiting_.push_back(std::move(task));
    if (waiting_.size() <= idle_) {
      come_.notify_one();
      return;
    }
    try {
      std::thread([this] { Loop(); }).detach();
    } catch (...) {
      waiting_.pop_back();
      throw;
    }
  }

 private:
  void Loop() {
    std::unique_lock lock(mutex_);
    ++idle_;
    while (true) {
      come_.wait(lock, [this] { return !waiting_.empty(); });
      --idle_;
      const Task task = std::move(waiting_.front());
      waiting_.pop_front();
      lock.unlock();
      task.work();
      lock.lock();
      ++idle_;
      lock.unlock();
      task.done();
      lock.lock();
    }
  }

  std::mutex mutex_;
  std::condition_variable come_;
  std::deque<Task> waiting_;
  size_t idle_ = 0;  // threads that wait, or will after their last task's done()
};

// Never destroyed: its threads wait when the process ends, and a condition variable with waiters cannot be destroyed.
JobThreads* threads = nullptr;

JobThreads& Threads() {
  static std::once_flag once;
  std::call_once(once, [] {
    threads = new JobThreads();
    pthread_atfork(nullptr, nullptr, [] { threads = new JobThreads(); });
  });
  return *threads;
}

}  // namespace

void RunOnJobThread(std::function<void()> work, std::function<void()> done) {
  Threads().Run({std::move(work), std::move(done)});
}

}  // namespace voxelpipe
