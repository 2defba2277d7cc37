// A function that a thread of its own calls periodically.
#pragma once

#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

namespace voxelpipe {

class Periodic {
 public:
  // Calls `work` every `interval` from now on. It must not throw.
  Periodic(std::chrono::milliseconds interval, std::function<void()> work)
      : thread_([this, interval, work = std::move(work)] {
          std::unique_lock lock(mutex_);
          while (!wake_.wait_for(lock, interval, [this] { return ended_; })) {
            lock.unlock();
            work();
            lock.lock();
          }
        }) {}
  // Waits for a running call; there is none afterwards.
  ~Periodic() {
    {
      const std::lock_guard lock(mutex_);
      ended_ = true;
    }
    wake_.notify_all();
    thread_.join();
  }
  Periodic(const Periodic&) = delete;
  Periodic& operator=(const Periodic&) = delete;

 private:
  std::mutex mutex_;
  std::condition_variable wake_;
  bool ended_ = false;
  std::thread thread_;  // last member: it uses the others
};

}  // namespace voxelpipe
