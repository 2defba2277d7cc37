// Returns idle pages of the pool to the system: for processes that run many jobs and know when they are idle.
#pragma once

#include <chrono>

namespace voxelpipe {

// Returns those blocks of the pool (page_pool.h) to the system that were unused since `moment`. Thread-safe.
void ReleasePagesIdleSince(std::chrono::steady_clock::time_point moment);

}  // namespace voxelpipe
