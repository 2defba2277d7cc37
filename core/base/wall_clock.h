// The clock that stages are timed with.
#pragma once

#include <chrono>

namespace voxelpipe {

// Milliseconds of wall time since some moment; never runs back.
inline double WallMs() {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace voxelpipe
