// The largest keys that a warp's triangles bring to voxels, in shared memory: neighbours in a mesh touch the same
// voxels, and then only the one with the largest goes to the target. No host-only includes.
#pragma once

#include <cstdint>

#include "cuda/primitives/warp_reduce.cuh"

namespace voxelpipe::cuda {

// A warp's. Keys are never 0: a cell that is 0 was touched by nobody.
struct KeyBox {
  static constexpr uint32_t kCells = 512;
  alignas(16) uint32_t cells[kCells];
};

// Where a voxel lies in a KeyBox; the same in all lanes.
struct KeyPlace {
  int offset = 0, row = 0, layer = 0;
  uint32_t count = 0;  // of cells; 0: the triangles reach too far

  __device__ bool fits() const { return count != 0; }
  __device__ int At(const int (&voxel)[3]) const { return offset + voxel[0] + voxel[1] * row + voxel[2] * layer; }
};

// The box of what the lanes with `has` reach, voxels `from` to `last`. All lanes call it.
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

// All lanes call it, and __syncwarp before and after.
__device__ inline void ClearKeys(KeyBox& box, const KeyPlace& place) {
  for (uint32_t i = threadIdx.x % 32; i * 4 < place.count; i += 32) {
    reinterpret_cast<uint4*>(box.cells)[i] = uint4{0, 0, 0, 0};
  }
}

}  // namespace voxelpipe::cuda
