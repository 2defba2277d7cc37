// The response to calls while the queue is full.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>

#include <grpcpp/support/status.h>

#include "absl/status/status.h"

namespace voxelpipe {

class Metrics;
class Scheduler;

// Under overload most calls are refused, and a refusal as expensive as a small job would take worker time. So the queue
// is checked before a call is read, one error is shared by all calls of the next moment, and the access log gets one
// line a second. Thread-safe.
class FullQueue {
 public:
  using Clock = std::chrono::steady_clock;

  struct Answer {
    absl::Status status;  // RESOURCE_EXHAUSTED with the retry delay
    grpc::Status grpc_status;
  };

  // Both must outlive this object.
  FullQueue(const Scheduler& scheduler, Metrics& metrics) : scheduler_(scheduler), metrics_(metrics) {}

  // Null if the queue is not full: a job may still be refused for its own traits. Counts the refusal as one of the
  // queue.
  std::shared_ptr<const Answer> Refusal(Clock::time_point now = Clock::now());
  // Set if this refusal gets a log line of its own: the number of refusals without one since the last line.
  std::optional<uint64_t> MayLog(Clock::time_point now = Clock::now());

 private:
  const Scheduler& scheduler_;
  Metrics& metrics_;
  std::mutex mutex_;
  std::shared_ptr<const Answer> answer_;
  Clock::time_point made_;
  std::optional<Clock::time_point> logged_;
  uint64_t unlogged_ = 0;
};

}  // namespace voxelpipe
