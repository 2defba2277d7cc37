// What FindCells (coverage_pass.cuh) says of a triangle, in 8 bytes each, in the order in which it takes them. No host-only
// includes.
#pragma once

#include <cstdint>

#include "base/host_device.h"

namespace voxelpipe::cuda {

// From bit 0: the bit of a voxel in the slab's bit grid, the first of a block of voxels (32 bits); which of the 2x2x2
// from there the triangle touches, x + 2y + 4z (8); the kind, at the end.
enum class CellKind : uint32_t {
  kOctants,  // as they stand; none where the triangle touches nothing
  kBlock,    // at most 4x4x4 voxels: a mask of 64 bits, x + 4y + 16z, stands in an array beside the records
  kOther,  // rows of voxels that other kernels make; in place of the voxel how many the triangle touches, if that is counted
};

VOXELPIPE_HD uint64_t PackCell(CellKind kind, uint32_t first, uint32_t octants) {
  return (uint64_t{octants} | uint64_t{uint32_t(kind)} << 30) << 32 | first;
}
VOXELPIPE_HD CellKind KindOfCell(uint64_t cell) {
  return CellKind(cell >> 62);
}
VOXELPIPE_HD uint32_t FirstOfCell(uint64_t cell) {
  return uint32_t(cell);
}
VOXELPIPE_HD uint32_t OctantsOfCell(uint64_t cell) {
  return uint32_t(cell >> 32) & 0xff;
}

inline constexpr int kBlockSide = 4;

// How many fragments triangles have, summed twice over: where those of a block's begin is found without a scan.
struct FragmentCounts {
  uint32_t of_chunk = 1;          // triangles: what a block of FindCells takes
  uint32_t chunks_of_group = 1;   // of kChunkGroups groups (span.h)
  uint64_t* of_block = nullptr;   // fragments of each chunk; null: not counted
  uint64_t* of_groups = nullptr;  // likewise of each group
};

}  // namespace voxelpipe::cuda
