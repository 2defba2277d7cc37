// Per-warp tile in shared memory that combines keys of a max blend: neighbours in a mesh touch the same voxels, and
// only the largest key is blended into the target. No host-only includes.
#pragma once

#include <cstdint>

#include "cuda/primitives/warp_reduce.cuh"

namespace voxelpipe::cuda {

// The tile. Key 0 marks an empty cell; valid keys are non-zero.
struct KeyBox {
  static constexpr uint32_t kCells = 512;
  alignas(16) uint32_t cells[kCells];
};

// The layout of a tile: maps a voxel to its cell. Uniform over the warp.
struct KeyPlace {
  int offset = 0, row = 0, layer = 0;
  uint32_t count = 0;  // number of cells; 0: the voxels do not fit

  __device__ bool fits() const { return count != 0; }
  __device__ int At(const int (&voxel)[3]) const { return offset + voxel[0] + voxel[1] * row + voxel[2] * layer; }
};

// The layout for the bounding box of voxels `from` to `last` of the lanes with `has`. All lanes call it.
__device__ inline KeyPlace FitKeys(bool has, const uint32_t (&from)[3], const uint32_t (&last)[3]) {
  uint32_t least[3], size[3];
  WarpBox(has, from, last, least, size);
  KeyPlace place;
  if (least[0] == ~0u || max(size[0], max(size[1], size[2])) > KeyBox::kCells) return place;
  const uint32_t count = size[0] * size[1] * size[2];
  if (count > KeyBox::kCells) return place;
  place.count = count;
  place.row = int(size[0]);
  place.layer = int(size[0] * size[1]);
  place.offset = -(int(least[0]) + int(least[1]) * place.row + int(least[2]) * place.layer);
  return place;
}

// Clears the tile. All lanes call it, with __syncwarp before and after.
__device__ inline void ClearKeys(KeyBox& box, const KeyPlace& place) {
  for (uint32_t i = threadIdx.x % 32; i * 4 < place.count; i += 32) {
    reinterpret_cast<uint4*>(box.cells)[i] = uint4{0, 0, 0, 0};
  }
}

}  // namespace voxelpipe::cuda
