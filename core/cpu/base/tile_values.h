// The values of occupied tiles, stored until the bricks of a sparse result are made from them.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "grid/host_buffer.h"
#include "raster/tiles.h"

namespace voxelpipe::cpu {

// The values of one tile's voxels with a fragment, in the tile's order (x + 32*(y + 8*z)): target after target; within
// a target voxel after voxel, components interleaved; bits as bytes 0 and 1. Targets that are the coverage itself have
// none.
struct TileValues {
  const uint8_t* data = nullptr;
  std::array<uint32_t, kTileRows> covered{};  // the voxels that have values
};

// A bump allocator for the tiles of one thread.
class ValueArena {
 public:
  // Throws std::bad_alloc.
  uint8_t* Take(uint64_t bytes);

 private:
  std::vector<HostBuffer> chunks_;
  uint64_t used_ = 0, total_ = 0;  // of the last chunk; of all
};

}  // namespace voxelpipe::cpu
