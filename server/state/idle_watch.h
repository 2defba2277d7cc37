// Idle clients: finds calls that have waited too long for their client.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <thread>

namespace voxelpipe {

// One per server. A wait costs a list entry and two clock readings, but no timer. Thread-safe.
class IdleWatch {
 public:
  using Clock = std::chrono::steady_clock;

  // Checks every `interval` on a thread of its own; 0: only when Look is called.
  explicit IdleWatch(std::chrono::milliseconds interval);
  ~IdleWatch();
  IdleWatch(const IdleWatch&) = delete;
  IdleWatch& operator=(const IdleWatch&) = delete;

  // One call's waits for its client, one after the other.
  class Wait {
   public:
    // `on_idle` is called once for a wait longer than `limit`, at most an interval late, on the watch's thread, without
    // locks and possibly after the end of this object: it should hold a weak pointer. `watch` must outlive the object.
    Wait(IdleWatch& watch, std::chrono::milliseconds limit, std::function<void()> on_idle);
    ~Wait();
    Wait(const Wait&) = delete;
    Wait& operator=(const Wait&) = delete;

    // Starts or restarts the wait for the client at `now`.
    void Begin(Clock::time_point now = Clock::now()) { since_ = now.time_since_epoch().count(); }
    // Ends the wait.
    void End() { since_ = kNotWaiting; }

   private:
    friend class IdleWatch;
    static constexpr Clock::rep kNotWaiting = 0;

    IdleWatch& watch_;
    const Clock::duration limit_;
    const std::function<void()> on_idle_;
    std::atomic<Clock::rep> since_{kNotWaiting};
    std::list<Wait*>::iterator place_;
  };

  // Calls on_idle for every wait that is too long at `now`.
  void Look(Clock::time_point now);

 private:
  std::mutex mutex_;
  std::condition_variable stopping_;
  std::list<Wait*> waits_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace voxelpipe
