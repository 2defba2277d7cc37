// The answer to calls while the queue is full.
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

// Under overload most calls are refused, and a refusal that costs as much as a small job takes its worker's time. So
// whether the queue is full is asked before anything of a call is read, the answer is made once and given to all who
// come in the next moment, and the access log has a line a second. Thread-safe.
class FullQueue {
 public:
  using Clock = std::chrono::steady_clock;

  struct Answer {
    absl::Status status;  // RESOURCE_EXHAUSTED with the time to come again
    grpc::Status grpc_status;
  };

  // Both must outlive this object.
  FullQueue(const Scheduler& scheduler, Metrics& metrics) : scheduler_(scheduler), metrics_(metrics) {}

  // Null where the queue is not full: a job may still be refused for what it is. Counts the refusal as one of the
  // queue's.
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
