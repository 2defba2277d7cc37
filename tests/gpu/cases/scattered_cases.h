// Requests for the unordered mesh: occupancy bits, sums, maxima and minima, which have kernels of their own if the grid
// exceeds the cache. Few real caches are so small; that of the emulator is.
#pragma once

#include <vector>

#include "gpu/cases/parity_cases.h"

namespace voxelpipe::gpu {

std::vector<ParityCase> ScatteredCases();

}  // namespace voxelpipe::gpu
