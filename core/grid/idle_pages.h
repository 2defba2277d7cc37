// Giving the pool's pages back: for those who run many jobs, and know when there are none.
#pragma once

#include <chrono>

namespace voxelpipe {

// Returns those blocks of the pool (page_pool.h) to the system that were unused since `moment`. Thread-safe.
void ReleasePagesIdleSince(std::chrono::steady_clock::time_point moment);

}  // namespace voxelpipe
