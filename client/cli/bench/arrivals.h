// When the requests of an open loop are due.
#pragma once

#include <chrono>
#include <cstdint>
#include <random>

namespace voxelpipe::cli {

enum class Arrivals {
  kPoisson,  // independent callers: exponential gaps
  kFixed,    // equal gaps
};

// The times are laid down before the first request leaves and do not wait for answers: a server that is late gets its
// requests all the same, and their latency counts from here.
class ArrivalSchedule {
 public:
  // `per_second` > 0. The same seed gives the same times.
  ArrivalSchedule(double per_second, Arrivals arrivals, uint64_t seed)
      : per_second_(per_second), arrivals_(arrivals), random_(seed) {}

  // Of the next request, since the start; ascending. The first of a fixed schedule is 0.
  std::chrono::nanoseconds Next();

 private:
  const double per_second_;
  const Arrivals arrivals_;
  std::mt19937_64 random_;
  uint64_t number_ = 0;  // of the next one
  double seconds_ = 0;   // when the last one was due
};

}  // namespace voxelpipe::cli
