// Flood fill within a word of a bit grid, for every device. No host-only includes.
#pragma once

#include <cstdint>

#include "base/host_device.h"

namespace voxelpipe {

// In: 32 voxels of a row as bits: those reached so far, and those that are open. Out: the open voxels that are
// connected to a reached one through open voxels, in both directions.
VOXELPIPE_HD uint32_t SpreadInWord(uint32_t reached, uint32_t open) {
  uint32_t up = reached & open, down = up, up_open = open, down_open = open;
  for (int step = 1; step < 32; step *= 2) {
    up |= up_open & (up << step);
    up_open &= up_open << step;
    down |= down_open & (down >> step);
    down_open &= down_open >> step;
  }
  return up | down;
}

}  // namespace voxelpipe
