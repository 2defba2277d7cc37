// Requests for the mesh whose triangles lie scattered: plain bits, sums, largest and least values, which kernels of
// their own make where the cache does not hold the grid. Few caches are so small; that of the kernels on the host is.
#pragma once

#include <vector>

#include "gpu/cases/parity_cases.h"

namespace voxelpipe::gpu {

std::vector<ParityCase> ScatteredCases();

}  // namespace voxelpipe::gpu
