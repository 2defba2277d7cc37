// The memory layout of a mip chain, for code that builds and samples it.
#pragma once

#include <cstdint>

#include "base/host_device.h"

namespace voxelpipe {

// Edge of a level: level 0 halved `level` times, rounded down, at least 1.
VOXELPIPE_HD uint32_t LevelEdge(uint32_t edge, uint32_t level) {
  const uint32_t halved = level < 32 ? edge >> level : 0;
  return halved > 0 ? halved : 1;
}

// Number of levels of a whole chain, including level 0 and the last one of a single texel.
VOXELPIPE_HD uint32_t CountLevels(uint32_t width, uint32_t height) {
  uint32_t levels = 1;
  while ((width >> levels) > 0 || (height >> levels) > 0) ++levels;
  return levels;
}

// Offset of `level` in TextureView::mips, in texels; for `level` = number of levels, the texels of all mips.
VOXELPIPE_HD uint64_t LevelOffset(uint32_t width, uint32_t height, uint32_t level) {
  uint64_t texels = 0;
  for (uint32_t l = 1; l < level; ++l) texels += uint64_t{LevelEdge(width, l)} * LevelEdge(height, l);
  return texels;
}

}  // namespace voxelpipe
