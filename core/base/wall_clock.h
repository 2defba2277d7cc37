// The clock that measures stages.
#pragma once

#include <chrono>

namespace voxelpipe {

// Milliseconds of wall time since an unspecified moment; monotonic.
inline double WallMs() {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

}  // namespace voxelpipe
