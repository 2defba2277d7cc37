#include "state/idle_watch.h"

#include <utility>
#include <vector>

namespace voxelpipe {

IdleWatch::IdleWatch(std::chrono::milliseconds interval) {
  if (interval.count() == 0) return;
  thread_ = std::thread([this, interval] {
    std::unique_lock lock(mutex_);
    while (!stopping_.wait_for(lock, interval, [this] { return stop_; })) {
      lock.unlock();
      Look(Clock::now());
      lock.lock();
    }
  });
}

IdleWatch::~IdleWatch() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  stopping_.notify_all();
  if (thread_.joinable()) thread_.join();
}

IdleWatch::Wait::Wait(IdleWatch& watch, std::chrono::milliseconds limit, std::function<void()> on_idle)
    : watch_(watch), limit_(limit), on_idle_(std::move(on_idle)) {
  const std::lock_guard lock(watch_.mutex_);
  place_ = watch_.waits_.insert(watch_.waits_.end(), this);
}

IdleWatch::Wait::~Wait() {
  const std::lock_guard lock(watch_.mutex_);
  watch_.waits_.erase(place_);
}

void IdleWatch::Look(Clock::time_point now) {
  std::vector<std::function<void()>> idle;
  {
    const std::lock_guard lock(mutex_);
    for (Wait* wait : waits_) {
      Clock::rep since = wait->since_;
      if (since == Wait::kNotWaiting || now - Clock::time_point(Clock::duration(since)) <= wait->limit_) continue;
      // Unless the client became active at this moment.
      if (wait->since_.compare_exchange_strong(since, Wait::kNotWaiting)) idle.push_back(wait->on_idle_);
    }
  }
  for (const std::function<void()>& on_idle : idle) on_idle();
}

}  // namespace voxelpipe
