// Where triangles were blended in a dense target, by blocks of its voxels: what is counted later. It takes a thirty-second of a bit grid, so it stays in the
// cache where the target, and such a grid, does not. No host-only includes.
#pragma once

#include <cstdint>

#include "cuda/reductions.cuh"

namespace voxelpipe::cuda {

// A byte for each block, x fastest, which is not 0 where voxels are touched from: from one of the block's on, up to kReach. Blocks are 16 voxels
// long and 4 wide and high: 64 bytes a row of a target of 32 bits.
struct TouchedBlocks {
  static constexpr int kLogX = 4, kLogYZ = 2;
  static constexpr int kReach[3] = {1 << kLogX, 2, 2};  // voxels along each axis

  uint8_t* marks = nullptr;      // null: nothing is marked
  uint32_t pitch = 0, rows = 0;  // bytes of a row, whole words; rows of a layer

  // Voxels from (x, y, z) of the slab on.
  __device__ void Touch(int x, int y, int z) const {
    SetMark(marks + (uint32_t(x >> kLogX) + pitch * (uint32_t(y >> kLogYZ) + rows * uint32_t(z >> kLogYZ))));
  }
  // Voxels [x_begin, x_end) of a row.
  __device__ void TouchRow(int x_begin, int x_end, int y, int z) const {
    for (int x = x_begin; x < x_end; x += kReach[0]) Touch(x, y, z);
  }
  // Voxels of a box of 4x4x4 from (x, y, z) on: x + 4y + 16z, at least one.
  __device__ void TouchBox(int x, int y, int z, uint64_t mask) const {
    const int last_z = z + (63 - __clzll(static_cast<long long>(mask))) / 16;
    const auto layers = uint32_t(mask | mask >> 32), layer = (layers | layers >> 16) & 0xffff;
    const int last_y = y + (31 - __clz(int(layer))) / 4;
    Touch(x, y, z);
    Touch(x, last_y, z);
    Touch(x, y, last_z);
    Touch(x, last_y, last_z);
  }
};

}  // namespace voxelpipe::cuda
