// The paths of the targets of the cases.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "gpu/cases/parity_options.h"

namespace voxelpipe::gpu {

// Prints how often each path ran. False if a path that the options allow never ran, if all cases run or options.paths
// is set.
bool PrintPaths(const std::map<std::string, uint64_t>& paths, const ParityOptions& options);

}  // namespace voxelpipe::gpu
