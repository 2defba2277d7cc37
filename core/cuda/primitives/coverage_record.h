// Coverage records: the voxels that a small triangle touches, in 8 bytes. FindCells (coverage_pass.cuh) writes one per
// triangle, in the order of its triangles. No host-only includes.
#pragma once

#include <cstdint>

#include "base/host_device.h"

namespace voxelpipe::cuda {

// Layout from bit 0: bit index in the slab's bit grid of the first voxel of a block (32 bits); mask of the 2x2x2 voxels
// from there that the triangle touches, x + 2y + 4z (8); CellKind, in the top 2 bits.
enum class CellKind : uint32_t {
  kOctants,  // the 2x2x2 mask; 0 if the triangle touches nothing
  kBlock,    // at most 4x4x4 voxels: the 64-bit mask, x + 4y + 16z, is in an array beside the records
  kOther,    // spans, made by other kernels; the voxel field has the number of touched voxels, if counted
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

// Fragment counts of chunks of triangles and of groups of chunks, so that a block finds its first output element
// without a scan.
struct FragmentCounts {
  uint32_t of_chunk = 1;          // triangles of a chunk: those of a block of FindCells
  uint32_t chunks_of_group = 1;   // chunks of each of kChunkGroups groups (span.h)
  uint64_t* of_block = nullptr;   // fragments of each chunk; null: not counted
  uint64_t* of_groups = nullptr;  // fragments of each group
};

}  // namespace voxelpipe::cuda
