// The scheduled send times of an open loop.
#pragma once

#include <chrono>
#include <cstdint>
#include <random>

namespace voxelpipe::cli {

enum class Arrivals {
  kPoisson,  // independent callers: exponential gaps
  kFixed,    // equal gaps
};

// The times are fixed before the first request and do not wait for responses: a slow server gets its requests
// nevertheless, and their latency counts from the scheduled time.
class ArrivalSchedule {
 public:
  // `per_second` > 0. The same seed gives the same times.
  ArrivalSchedule(double per_second, Arrivals arrivals, uint64_t seed)
      : per_second_(per_second), arrivals_(arrivals), random_(seed) {}

  // The send time of the next request, since the start; ascending. The first of a fixed schedule is 0.
  std::chrono::nanoseconds Next();

 private:
  const double per_second_;
  const Arrivals arrivals_;
  std::mt19937_64 random_;
  uint64_t number_ = 0;  // of the next one
  double seconds_ = 0;   // send time of the last one
};

}  // namespace voxelpipe::cli
