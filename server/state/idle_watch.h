// Clients that do nothing: finds calls that have waited too long for their client.
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

// One for a server. Costs a call that goes well a list entry and two clock readings a wait, and no timer. Thread-safe.
class IdleWatch {
 public:
  using Clock = std::chrono::steady_clock;

  // Looks every `interval` on a thread of its own; 0: only when Look is called.
  explicit IdleWatch(std::chrono::milliseconds interval);
  ~IdleWatch();
  IdleWatch(const IdleWatch&) = delete;
  IdleWatch& operator=(const IdleWatch&) = delete;

  // One call's waits for its client, one after the other.
  class Wait {
   public:
    // `on_idle` is called once for a wait that lasts longer than `limit`, at most an interval late, on the watch's
    // thread, without locks and possibly after this object is gone: let it hold a weak pointer. `watch` must outlive
    // the object.
    Wait(IdleWatch& watch, std::chrono::milliseconds limit, std::function<void()> on_idle);
    ~Wait();
    Wait(const Wait&) = delete;
    Wait& operator=(const Wait&) = delete;

    // From `now` on the client is waited for, whether or not it was before.
    void Begin(Clock::time_point now = Clock::now()) { since_ = now.time_since_epoch().count(); }
    // The client did its part.
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
