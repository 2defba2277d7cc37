// Which paths made the targets of the cases.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "gpu/cases/parity_options.h"

namespace voxelpipe::gpu {

// Prints how often each path made a target. False if one never ran that the options lead to, where all cases run or
// options.paths asks for it.
bool PrintPaths(const std::map<std::string, uint64_t>& paths, const ParityOptions& options);

}  // namespace voxelpipe::gpu
