// Sparse results: bricks of the occupied voxels of a slab.
#pragma once

#include <array>
#include <vector>

#include "absl/status/statusor.h"
#include "cpu/base/tile_values.h"
#include "cpu/tile_buffer.h"

namespace voxelpipe::cpu {

// Returns a copy of a tile's values: what TileBuffer::Store writes to a dense target.
TileValues KeepTile(const RunState& state, const std::vector<TileBuffer>& buffers,
                    const std::array<uint32_t, kTileRows>& covered, ValueArena& arena);

// Bytes that KeepTile takes for the values of these voxels.
uint64_t KeptTileBytes(const RunState& state, const std::array<uint32_t, kTileRows>& covered);

// Makes the slab's brick, mask and target arrays from its bits and the tiles' values.
absl::StatusOr<ResultArrays> MakeBricks(const RunState& state);

}  // namespace voxelpipe::cpu
