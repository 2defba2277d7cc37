// How much memory this process may use.
#pragma once

#include <cstdint>

namespace voxelpipe {

// Bytes of memory of this machine, or of the control group that bounds the process, whichever is less.
uint64_t MemoryBytes();

}  // namespace voxelpipe
