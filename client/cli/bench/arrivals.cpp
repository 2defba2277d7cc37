#include "bench/arrivals.h"

#include <cmath>

namespace voxelpipe::cli {

std::chrono::nanoseconds ArrivalSchedule::Next() {
  if (arrivals_ == Arrivals::kFixed) {
    seconds_ = double(number_++) / per_second_;
  } else {
    const double uniform = double(random_() >> 11) * 0x1p-53;  // [0, 1); std's distributions differ between libraries
    seconds_ += -std::log1p(-uniform) / per_second_;
  }
  return std::chrono::nanoseconds(int64_t(std::llround(seconds_ * 1e9)));
}

}  // namespace voxelpipe::cli
