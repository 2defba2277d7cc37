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

// The state that the lanes of one run share. Constant once they start, except for the atomics.
struct LoadRun {
  bool closed_loop = true;
  LoadClock::time_point begin, end;  // of the measured window
  std::optional<std::chrono::milliseconds> deadline;
  std::string expected_hash;
  bool honour_retry = false;
  // The messages of one call, in order, serialized once. Of VoxelizeBatch: one job, without its id.
  using Variant = std::vector<grpc::ByteBuffer>;
  std::vector<Variant> variants;  // used in rotation
  std::string method;             // of single calls: the path of Voxelize or VoxelizeUpload
  std::atomic<uint64_t> turn{0};
  std::atomic<int64_t> in_flight{0};
  std::atomic<bool> stop{false};    // no new requests
  std::atomic<bool> cancel{false};  // and cancel running ones

  const Variant& NextVariant() { return variants[turn.fetch_add(1, std::memory_order_relaxed) % variants.size()]; }
};

// Start() sends immediately. In a closed loop each response starts the next request until the window ends.
class Lane {
 public:
  virtual ~Lane() = default;
  // Sends a request scheduled for `due`. From one thread at a time, not necessarily the lane's own.
  virtual void Start(LoadClock::time_point due) = 0;
  // Call when no request is outstanding: ends the lane's thread. Out: its counts, and the time of its last response.
  struct Ended {
    Tally tally;
    LoadClock::time_point last_answer{};
  };
  virtual Ended End() = 0;
};

// `run` must outlive the lane.
std::unique_ptr<Lane> MakeCallLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run);
std::unique_ptr<Lane> MakeManyLane(std::shared_ptr<grpc::Channel> channel, LoadRun& run);

// True if an error has a RetryInfo. Searches for its name, because parsing thousands a second is too slow.
inline bool SaysWhenToRetry(const grpc::Status& status) {
  return status.error_details().find("/google.rpc.RetryInfo") != std::string::npos;
}

// The time to resend a request with this error, if retries are honoured and the time is within the window.
inline std::optional<LoadClock::time_point> ResendAt(const LoadRun& run, const absl::Status& failure) {
  if (!run.honour_retry) return std::nullopt;
  const std::optional<std::chrono::milliseconds> delay = RetryDelay(failure);
  if (!delay) return std::nullopt;
  const LoadClock::time_point at = LoadClock::now() + std::max(*delay, std::chrono::milliseconds(1));
  return at < run.end ? std::optional(at) : std::nullopt;
}

// Adds one outcome to the lane's counts, if its request was scheduled within the window.
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
