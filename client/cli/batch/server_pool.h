// Chooses the server for the next job.
#pragma once

#include <chrono>
#include <cstddef>
#include <mutex>
#include <optional>
#include <vector>

namespace voxelpipe::cli {

// Thread-safe. Callers pass the time, so that tests need not wait.
class ServerPool {
 public:
  using Clock = std::chrono::steady_clock;
  using TimePoint = Clock::time_point;

  explicit ServerPool(size_t servers) : servers_(servers) {}

  // The server with the fewest running jobs among those not suspended, and adds a job to it. Empty if all are
  // suspended.
  std::optional<size_t> Take(TimePoint now);
  // The end of the first suspension.
  TimePoint NextFree() const;

  // The time since which no server can be reached; empty while one can.
  std::optional<TimePoint> GoneSince() const;

  // Removes a job from a server, once for each Take.
  void Return(size_t server);

  // The outcome of a job, for the state of its server:
  void Answered(size_t server);  // it returned a result, or an error of the job itself
  // It could not be reached or became unavailable: it is suspended for a quarter of a second, doubling each time in a
  // row up to half a minute. Jobs that fail during the suspension do not count: they ran at the same time.
  void Lost(size_t server, TimePoint now);
  // No connection could be made: like Lost, and it counts as unreachable until another outcome.
  void Unreachable(size_t server, TimePoint now);
  // It is overloaded and returned a retry delay.
  void Busy(size_t server, TimePoint now, std::chrono::milliseconds delay);

 private:
  void Rest(size_t server, TimePoint now);  // under the lock

  struct Server {
    size_t jobs = 0;
    int losses = 0;  // in a row
    TimePoint rests_until{};
    std::optional<TimePoint> gone_since{};
  };
  mutable std::mutex mutex_;
  std::vector<Server> servers_;
  size_t next_ = 0;  // tie-breaker
};

}  // namespace voxelpipe::cli
