// What a launch of the fine raster gets. No host-only includes.
#pragma once

#include "cuda/primitives/blend_rules.cuh"
#include "cuda/primitives/list_sizes.h"
#include "cuda/primitives/views.h"
#include "cuda/primitives/voxel_code.h"

namespace voxelpipe::cuda {

inline constexpr int kFineThreads = 256;

inline constexpr uint32_t kPartsJoined = 8;  // of a split tile (list_sizes.h)

// As long as no tile has more parts than this many levels of kPartsJoined can join.
inline constexpr uint32_t kPartLevels = 4;

VOXELPIPE_HD uint32_t PartsOf(uint32_t pairs_of_tile, uint32_t pairs) {
  const uint32_t parts = (pairs_of_tile + pairs - 1) / pairs;
  return parts < kPartsSplit ? 1 : parts;
}

struct TilePart {
  uint32_t slot = 0, part = 0;  // of which occupied tile which one; a tile's parts stand together, in order
};

struct TileParts {
  const TilePart* list = nullptr;  // null: no tile is split
  const uint64_t* count = nullptr;
  uint32_t pairs = 0;           // of a part
  uint32_t capacity = 0;        // at least as many as there are parts
  uint32_t* results = nullptr;  // of each part: the launch's shared words, then what it touched and covered
  uint32_t* done = nullptr;     // kPartLevels times `capacity`, all 0 between launches
};

// What one launch blends: the targets that share a tile in shared memory.
struct FineArgs {
  GridView grid;
  const MeshView* mesh = nullptr;
  const VertexCode* codes = nullptr;  // of the vertices
  Coverage coverage{};
  const uint32_t *pair_triangles = nullptr, *tile_begin = nullptr, *tile_end = nullptr, *occupied_tiles = nullptr;
  const uint64_t* occupied_count = nullptr;
  uint64_t first_tile = 0;  // what is added to a tile's number for its number in the grid
  uint64_t* next_tile = nullptr;
  uint64_t* fragments = nullptr;  // null: another launch counts them
  uint32_t* coverage_bits = nullptr;
  bool any_always_present = false;  // of all launches together
  bool shades = false, planar = false, has_owners = false;
  ShaderTraits traits;             // of the launch's targets together
  uint8_t* tile_values = nullptr;  // sparse results, null for dense ones
  uint64_t value_stride = 0;
  uint64_t value_offset[kMaxTargets] = {};
  uint64_t slab_voxels = 0;
  TileParts parts;
  TileTarget targets[kMaxTargets];
  int target_count = 0;
  int shared_words = 0;  // of the targets' tiles
};

}  // namespace voxelpipe::cuda
