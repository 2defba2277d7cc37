// Base of the lanes of single calls: reused calls, the thread that serves their events, and the actions after a
// response.
#pragma once

#include <chrono>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include <grpcpp/alarm.h>
#include <grpcpp/client_context.h>
#include <grpcpp/generic/generic_stub.h>

#include "bench/lane.h"

namespace voxelpipe::cli {

struct SingleCall {
  LoadClock::time_point due, sent;
  std::optional<grpc::ClientContext> context;
  grpc::ByteBuffer buffer;
  grpc::Status status;
  grpc::Alarm alarm;
  bool active = false;
  bool resending = false;  // waits for resending
  uint32_t resends = 0;
};

// `Call` is a SingleCall, default constructible and not movable. A derived class calls Serve last in the constructor
// and Join in the destructor: the thread uses all of the object.
template <typename Call>
class SingleCalls : public Lane {
 public:
  void Start(LoadClock::time_point due) override {
    Call* call = nullptr;
    {
      const std::lock_guard lock(mutex_);
      if (free_.empty()) {
        call = &calls_.emplace_back();
      } else {
        call = free_.back();
        free_.pop_back();
      }
    }
    run_.in_flight.fetch_add(1, std::memory_order_relaxed);
    LaunchAt(*call, due);
  }

  Ended End() override {
    queue_.Shutdown();
    thread_.join();
    return tally_.ended();
  }

 protected:
  SingleCalls(std::shared_ptr<grpc::Channel> channel, LoadRun& run)
      : run_(run), stub_(std::move(channel)), tally_(run) {}

  void Serve() {
    thread_ = std::thread([this] { Loop(); });
  }
  void Join() {
    if (thread_.joinable()) End();
  }

  // Sends the call, whose context is new.
  virtual void Launch(Call& call) = 0;
  virtual void Handle(void* tag, bool ok) = 0;

  // The tag at the end of a pause of this call: Handle calls Again.
  virtual void* PauseTag(Call& call) = 0;

  // The call ended.
  void Complete(Call& call, Outcome& outcome) {
    // Without a pause a closed loop would spin when its server is gone: refused calls return immediately.
    constexpr std::chrono::milliseconds kPauseUnavailable{10};
    if (outcome.code != absl::StatusCode::kOk) outcome.retry_info = SaysWhenToRetry(call.status);
    if (outcome.retry_info) {
      if (const auto at = ResendAt(run_, FromGrpcStatus(call.status))) {
        ++call.resends;
        call.resending = true;
        call.active = false;
        const auto wait = std::chrono::duration_cast<std::chrono::microseconds>(*at - LoadClock::now());
        call.alarm.Set(&queue_, std::chrono::system_clock::now() + wait, PauseTag(call));
        return;
      }
    }
    outcome.resends = std::exchange(call.resends, 0);
    tally_.Add(call.due, call.sent, outcome);
    call.active = false;
    const bool told_to_wait = run_.honour_retry && outcome.retry_info;  // after the window
    if (!run_.closed_loop || told_to_wait) {
      Release(call);
    } else if (outcome.code == absl::StatusCode::kUnavailable) {
      call.alarm.Set(&queue_, std::chrono::system_clock::now() + kPauseUnavailable, PauseTag(call));
    } else {
      Again(call);
    }
  }

  void Again(Call& call) {
    const LoadClock::time_point now = LoadClock::now();
    if (std::exchange(call.resending, false) && !run_.cancel.load(std::memory_order_relaxed)) {
      Send(call);
    } else if (run_.stop.load(std::memory_order_relaxed) || now >= run_.end) {
      Release(call);
    } else {
      LaunchAt(call, now);
    }
  }

  LoadRun& run_;
  grpc::GenericStub stub_;
  grpc::CompletionQueue queue_;

 private:
  void LaunchAt(Call& call, LoadClock::time_point due) {
    call.due = due;
    call.sent = LoadClock::now();
    Send(call);
  }

  void Send(Call& call) {
    call.context.emplace();
    if (run_.deadline) call.context->set_deadline(std::chrono::system_clock::now() + *run_.deadline);
    call.active = true;
    Launch(call);
  }

  void Loop() {
    constexpr std::chrono::milliseconds kPollInterval{100};  // poll interval of the flags of the run
    for (;;) {
      void* tag = nullptr;
      bool ok = false;
      const auto next = queue_.AsyncNext(&tag, &ok, std::chrono::system_clock::now() + kPollInterval);
      if (next == grpc::CompletionQueue::SHUTDOWN) return;
      if (next == grpc::CompletionQueue::GOT_EVENT) Handle(tag, ok);
      if (run_.cancel.load(std::memory_order_relaxed)) CancelAll();
    }
  }

  void Release(Call& call) {
    {
      const std::lock_guard lock(mutex_);
      free_.push_back(&call);
    }
    run_.in_flight.fetch_sub(1, std::memory_order_release);
  }

  // Only once no thread starts calls any more.
  void CancelAll() {
    if (std::exchange(cancelled_, true)) return;
    const std::lock_guard lock(mutex_);
    for (Call& call : calls_) {
      if (call.active) call.context->TryCancel();
    }
  }

  std::mutex mutex_;        // guards the next two
  std::deque<Call> calls_;  // stable addresses
  std::vector<Call*> free_;
  LaneTally tally_;
  bool cancelled_ = false;
  std::thread thread_;
};

}  // namespace voxelpipe::cli
