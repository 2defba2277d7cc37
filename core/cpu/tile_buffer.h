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

  // Writes the voxels with a fragment to the target. `range` is the tile clipped to the grid.
  void Store(const RunState& state, const VoxelRange& range, CpuTarget& target) const;

  const std::array<uint32_t, kTileRows>& presence() const { return presence_; }

 private:
  void StoreBits(const RunState& state, const VoxelRange& range, BitGrid& grid,
                 const std::array<uint32_t, kTileRows>& words) const;
  float ValueAt(int voxel, int component) const;

  TargetSpec spec_;
  bool u32_output_;
  std::array<uint32_t, kTileRows> presence_{};
  std::array<uint32_t, kTileRows> bits_{};  // bit targets
  std::vector<float> values_;               // f32: replace, min, max
  std::vector<int64_t> sums_;               // f32: add, multiples of the quantum
};

}  // namespace voxelpipe::cpu
