// What a launch of the fine raster gets. No host-only includes.
#pragma once

#include "cuda/tile_blend.cuh"
#include "cuda/vertex_code.cuh"
#include "cuda/views.h"

namespace voxelpipe::cuda {

inline constexpr int kFineThreads = 256;

// What one launch blends: the targets that share a tile in shared memory.
struct FineArgs {
  GridView grid;
  const MeshView* mesh = nullptr;
  const VertexCode* codes = nullptr;  // of the vertices
  Coverage coverage{};
  const uint32_t *pair_triangles = nullptr, *tile_begin = nullptr, *tile_end = nullptr, *occupied_tiles = nullptr;
  const uint64_t* occupied_count = nullptr;
  uint64_t* next_tile = nullptr;
  uint64_t* fragments = nullptr;  // null: another launch counts them
  uint32_t* coverage_bits = nullptr;
  bool any_always_present = false;  // of all launches together
  bool shades = false, planar = false, has_owners = false;
  bool uniform = false;            // one target, whose value is the same for all fragments of a triangle
  ShaderTraits traits;             // of the launch's targets together
  uint8_t* tile_values = nullptr;  // sparse results, null for dense ones
  uint64_t value_stride = 0;
  uint64_t value_offset[kMostTargets] = {};
  uint64_t slab_voxels = 0;
  TileTarget targets[kMostTargets];
  int target_count = 0;
  int shared_words = 0;  // of the targets' tiles
};

}  // namespace voxelpipe::cuda
