// How many blocks a launch takes. Included by .cu files only.
#pragma once

#include <algorithm>
#include <cstdint>

namespace voxelpipe::cuda {

// Blocks for `count` pieces of work, `each` of them a block; at least one, and at most `most`, whose threads then take further pieces in
// strides of the grid.
inline unsigned BlocksFor(uint64_t count, uint64_t each, uint64_t most = 1 << 16) {
  return unsigned(std::clamp<uint64_t>((count + each - 1) / each, 1, most));
}

}  // namespace voxelpipe::cuda
