// Fragments of the largest triangles, which are listed apart from all others (apart_fragments.cuh) and merged with them (merge_fragments.cuh): what
// kernels get. Plain structs, no host-only includes.
#pragma once

#include <cstdint>

#include "base/host_device.h"
#include "cuda/views.h"

namespace voxelpipe::cuda {

struct SharedSetup;
struct LargestTriangles;

struct ApartArgs {
  GridView grid;                              // its slab, rows of fewer than 2^16 voxels
  const LargestTriangles* largest = nullptr;  // which they are
  SharedSetup* setups = nullptr;              // theirs, in the order of ids
  uint32_t *keys = nullptr, *triangles = nullptr;
  uint64_t room = 0;           // fragments; what is beyond it is not written
  uint32_t groups = 0;         // of rows
  uint64_t* before = nullptr;  // of each of them (look_back.cuh): 0
  uint32_t* taken = nullptr;   // how many of them blocks have taken: 0
  uint64_t* total = nullptr;   // becomes the number of fragments
};

// By voxel, and of one voxel by triangle.
struct SortedFragments {
  const uint32_t *keys = nullptr, *triangles = nullptr;
  uint64_t count = 0;
};

struct MergeArgs {
  SortedFragments from[2];
  uint32_t *keys = nullptr, *triangles = nullptr;
  uint64_t* splits = nullptr;  // how many fragments before each block are the first list's; and of all
  uint64_t* before = nullptr;  // of the blocks, which FindSplits clears for look_back.cuh

  VOXELPIPE_HD uint64_t count() const { return from[0].count + from[1].count; }
};

}  // namespace voxelpipe::cuda
