// One connection of a load, served by one thread.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <grpcpp/channel.h>
#include <grpcpp/completion_queue.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/status.h>

#include "bench/load.h"
#include "wire/status.h"

namespace voxelpipe::cli {

using LoadClock = std::chrono::steady_clock;

// What the lanes of one run share. Written before they start, but for the atomics.
struct LoadRun {
  bool closed_loop = true;
  LoadClock::time_point begin, end;  // of the window that counts
  std::optional<std::chrono::milliseconds> deadline;
  std::string expected_hash;
  bool honour_retry = false;
  // The messages of one call, in order, serialized once. Of VoxelizeMany: one message, without its id.
  using Variant = std::vector<grpc::ByteBuffer>;
  std::vector<Variant> variants;  // taken in turn
  std::atomic<uint64_t> turn{0};
  std::atomic<int64_t> in_flight{0};
  std::atomic<bool> stop{false};    // no new requests
  std::atomic<bool> cancel{false};  // and no patience for those under way

  const Variant& NextVariant() { return variants[turn.fetch_add(1, std::memory_order_relaxed) % variants.size()]; }
};

// Lanes know no pause of their own: Start() sends at once. In a closed loop a request that is answered is followed by
// the next until the window ends.
class Lane {
 public:
  virtual ~Lane() = default;
  // Sends a request that was due at `due`. From one thread at a time, which need not be the lane's own.
  virtual void Start(LoadClock::time_point due) = 0;
  // Call once nothing is under way any more: ends the lane's thread. Out: what it counted, and when its last answer
  // came.
  struct Ended {
    Tally tally;
    LoadClock::time_point last_answer{};
  };
  virtual Ended End() = 0;
};

// `run` must outlive the lane.
std::unique_ptr<Lane> MakeCallLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run);
std::unique_ptr<Lane> MakeManyLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run);
std::unique_ptr<Lane> MakeUnaryLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run);

// True if an error has a RetryInfo. Looks for its name: thousands a second are not parsed.
inline bool SaysWhenToRetry(const grpc::Status& status) {
  return status.error_details().find("/google.rpc.RetryInfo") != std::string::npos;
}

// When a request that failed so is to be sent again, where retries are honoured and the window is not over by then.
inline std::optional<LoadClock::time_point> ResendAt(const LoadRun& run, const absl::Status& failure) {
  if (!run.honour_retry) return std::nullopt;
  const std::optional<std::chrono::milliseconds> delay = RetryDelay(failure);
  if (!delay) return std::nullopt;
  const LoadClock::time_point at = LoadClock::now() + std::max(*delay, std::chrono::milliseconds(1));
  return at < run.end ? std::optional(at) : std::nullopt;
}

// The lane's count of one outcome: only requests that were due within the window count.
class LaneTally {
 public:
  explicit LaneTally(const LoadRun& run) : run_(run) {}

  void Add(LoadClock::time_point due, LoadClock::time_point sent, Outcome& outcome) {
    const LoadClock::time_point now = LoadClock::now();
    if (due < run_.begin) return;
    outcome.latency_ns = uint64_t(std::chrono::nanoseconds(now - due).count());
    outcome.lag_ns = uint64_t(std::chrono::nanoseconds(sent - due).count());
    ended_.tally.Add(outcome);
    ended_.last_answer = now;
  }
  const Lane::Ended& ended() const { return ended_; }

 private:
  const LoadRun& run_;
  Lane::Ended ended_;
};

}  // namespace voxelpipe::cli
