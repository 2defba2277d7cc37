// Counts of the core, which are never negative, and those of messages.
#pragma once

#include <algorithm>
#include <cstdint>

namespace voxelpipe {

// A count in a message from the other side, which may hold anything: negative ones become 0.
inline uint64_t CountOf(int64_t value) {
  return uint64_t(std::max<int64_t>(value, 0));
}

}  // namespace voxelpipe
