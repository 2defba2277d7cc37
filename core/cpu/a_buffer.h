// The sort-last pipeline: all fragments of each voxel.
//
// Source: J. Pantaleoni, "VoxelPipe", HPG 2011, section 4 (bucketing). Changed: fragments are emitted tile by tile, so
// that sorting them by voxel is a counting sort within a tile, triangle ids staying in order, and a scan over the
// tiles' rows; no global sort of fragments is needed.
#pragma once

#include <array>
#include <span>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "cpu/run_state.h"

namespace voxelpipe::cpu {

// One triangle's fragments in one row of a tile.
struct RowFragments {
  uint32_t triangle;
  uint32_t mask;  // voxels of the row
  uint32_t row;   // y + 8*z of the tile
};

// The fragments of a tile by ascending triangle id, and the positions of its rows in the slab's lists.
struct TileFragments {
  std::vector<std::span<const RowFragments>> records;
  std::array<uint32_t, kTileRows> row_voxels{};  // voxels with a fragment, as bits
  std::array<uint64_t, kTileRows>
      row_fragments{};  // number of fragments; after SortFragments the index of the first one in the slab
  std::array<uint64_t, kTileRows>
      row_first_voxel{};  // after SortFragments: index of the row's first voxel among the slab's listed ones
};

struct ABuffer {
  std::vector<TileFragments> tiles;  // one a tile run of the slab
  tbb::enumerable_thread_specific<ValueArena> arenas;
  uint64_t list_bytes = 0;             // of `tiles` and their records
  uint64_t fragments = 0, voxels = 0;  // of the slab
  ResultArrays arrays;                 // Resolve
};

// The stages; see pipeline/stages/stages.h. A fragment is dropped if the shaders of all targets discard it; if only
// some do, their targets hold their clear value.
absl::Status EmitFragments(RunState& state);
absl::Status SortFragments(RunState& state);
absl::Status Resolve(RunState& state);

}  // namespace voxelpipe::cpu
