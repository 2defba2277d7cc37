// Which of several servers gets the next job.
#pragma once

#include <chrono>
#include <cstddef>
#include <mutex>
#include <optional>
#include <vector>

namespace voxelpipe::cli {

// Thread-safe. Times are given, not read, so that tests need not wait.
class ServerPool {
 public:
  using Clock = std::chrono::steady_clock;
  using TimePoint = Clock::time_point;

  explicit ServerPool(size_t servers) : servers_(servers) {}

  // The server with the fewest jobs under way of those that do not rest; it has one more from now on. Nothing where all
  // rest.
  std::optional<size_t> Take(TimePoint now);
  // When the first of them ends its rest.
  TimePoint NextFree() const;

  // Since when all servers are gone; nothing while one is not.
  std::optional<TimePoint> GoneSince() const;

  // Gives a place back, once for each Take.
  void Return(size_t server);

  // What a job has shown of its server:
  void Answered(size_t server);  // it gave a result, or an error that is the job's own
  // It could not be reached or went away: it rests for a quarter of a second, each time in a row twice as long, up to
  // half a minute. Jobs that fail while it rests already do not count: they were under way together.
  void Lost(size_t server, TimePoint now);
  // No connection could be made: as Lost, and it counts as gone until something else is shown of it.
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
  size_t next_ = 0;  // of equals
};

}  // namespace voxelpipe::cli
