#include "job_threads.h"

#include <pthread.h>

#include <condition_variable>
#include <cstddef>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

namespace voxelpipe {
namespace {

struct Task {
  std::function<void()> work, done;
};

class JobThreads {
 public:
  void Run(Task task) {
    const std::lock_guard lock(mutex_);
    if (!idle_.empty()) {
      Worker& last = *idle_.back();
      idle_.pop_back();
      last.task = std::move(task);
      last.come.notify_one();
      return;
    }
    idle_.reserve(threads_ + 1);  // so that a thread that becomes idle allocates nothing
    std::thread([this, first = std::move(task)]() mutable { Loop(std::move(first)); }).detach();
    ++threads_;
  }

 private:
  struct Worker {
    std::condition_variable come;
    std::optional<Task> task;
  };

  void Loop(Task first) {
    Worker self;
    self.task = std::move(first);
    std::unique_lock lock(mutex_);
    while (true) {
      self.come.wait(lock, [&] { return self.task.has_value(); });
      const Task task = *std::exchange(self.task, std::nullopt);
      lock.unlock();
      task.work();
      lock.lock();
      idle_.push_back(&self);
      lock.unlock();
      task.done();
      lock.lock();
    }
  }

  std::mutex mutex_;
  std::vector<Worker*> idle_;  // they wait, or will after done() of their task; the last one became idle last
  size_t threads_ = 0;
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
