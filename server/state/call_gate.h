// Counts the calls in progress: limits their number, and a drain can wait for the end of the last one.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <functional>
#include <list>
#include <mutex>
#include <utility>
#include <vector>

namespace voxelpipe {

// Thread-safe. Must outlive its passes.
class CallGate {
 public:
  // Lets at most `max_inside` in at the same time.
  explicit CallGate(size_t max_inside) : max_inside_(max_inside) {}

  // The admission of one call. False if the gate was closed or full at its creation.
  class Pass {
   public:
    explicit Pass(CallGate& gate) : gate_(gate.Enter(full_) ? &gate : nullptr) {}
    ~Pass() {
      if (gate_ != nullptr) gate_->Leave();
    }
    Pass(const Pass&) = delete;
    Pass& operator=(const Pass&) = delete;
    explicit operator bool() const { return gate_ != nullptr; }
    bool full() const { return full_; }  // false because the gate was full

   private:
    bool full_ = false;
    CallGate* const gate_;
  };

  // During its lifetime, its function is called when the gate closes, or immediately if it is already closed. Possibly
  // also after its end: the function should hold a weak pointer.
  class Closer {
   public:
    Closer(CallGate& gate, const std::function<void()>& on_close) : gate_(gate) {
      bool closed;
      {
        const std::lock_guard lock(gate_.mutex_);
        closed = gate_.closed_;
        place_ = gate_.closers_.insert(gate_.closers_.end(), on_close);
      }
      if (closed) on_close();
    }
    ~Closer() {
      const std::lock_guard lock(gate_.mutex_);
      gate_.closers_.erase(place_);
    }
    Closer(const Closer&) = delete;
    Closer& operator=(const Closer&) = delete;

   private:
    CallGate& gate_;
    std::list<std::function<void()>>::iterator place_;
  };

  // Closes the gate: every new pass is false.
  void Close() {
    std::vector<std::function<void()>> closers;
    {
      const std::lock_guard lock(mutex_);
      closed_ = true;
      closers.assign(closers_.begin(), closers_.end());
    }
    for (const std::function<void()>& closer : closers) closer();
  }

  // True if all passes were released by `deadline`.
  bool WaitUntilEmpty(std::chrono::steady_clock::time_point deadline) {
    std::unique_lock lock(mutex_);
    return left_.wait_until(lock, deadline, [this] { return inside_ == 0; });
  }

 private:
  bool Enter(bool& full) {
    const std::lock_guard lock(mutex_);
    full = !closed_ && inside_ >= max_inside_;
    if (closed_ || full) return false;
    ++inside_;
    return true;
  }
  void Leave() {
    const std::lock_guard lock(mutex_);
    --inside_;
    left_.notify_all();
  }

  const size_t max_inside_;
  std::mutex mutex_;
  std::condition_variable left_;
  size_t inside_ = 0;
  bool closed_ = false;
  std::list<std::function<void()>> closers_;
};

}  // namespace voxelpipe
