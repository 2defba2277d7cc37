// One tile of one render target while it is blended: the CPU's counterpart of on-chip memory.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "cpu/run_state.h"
#include "shaders/blend_ops.h"

namespace voxelpipe::cpu {

// Local voxel of a tile: x + 32*(y + 8*z); row r = y + 8*z is one word of bits.
class TileBuffer {
 public:
  explicit TileBuffer(const CpuTarget& target);

  // Forgets the previous tile. Values need no clearing: blending starts from the first fragment.
  void Begin() { presence_.fill(0); }

  // Blends one fragment into voxel `bit` of row `row`. Fragments of a voxel arrive by ascending triangle id.
  void Blend(int row, int bit, const FragmentOutput& out);

  // Writes the voxels with a fragment to the dense target, and the bits of bit targets and presence to their grids. `range` is
  // the tile clipped to the grid.
  void Store(const RunState& state, const VoxelRange& range, CpuTarget& target) const;
  void StoreBitGrids(const RunState& state, const VoxelRange& range, CpuTarget& target) const;

  // The stored bits (blend_ops.h) of component c of a local voxel with a fragment; 0 or 1 for a bit target.
  uint32_t StoredAt(int voxel, int c) const;
  bool Has(int voxel) const { return (presence_[size_t(voxel / 32)] >> (voxel % 32) & 1) != 0; }

 private:
  enum class Kept : uint8_t { kBits, kCells, kSums, kCounts, kAverages };

  template <typename Element>
  void StoreElements(const RunState& state, const VoxelRange& range, CpuTarget& target) const;
  void StoreWords(const RunState& state, const VoxelRange& range, BitGrid& grid,
                  const std::array<uint32_t, kTileRows>& words) const;

  TargetSpec spec_;
  bool u32_output_, is_float_;
  double scale_;
  Kept kept_;
  std::array<uint32_t, kTileRows> presence_{};
  std::array<uint32_t, kTileRows> bits_{};  // kBits
  std::vector<uint32_t> cells_;             // kCells: voxel by voxel, components together
  std::vector<int64_t> sums_;               // kSums, kAverages
  std::vector<uint32_t> counts_;            // kCounts, kAverages: one a voxel
};

}  // namespace voxelpipe::cpu
