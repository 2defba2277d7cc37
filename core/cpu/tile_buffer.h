// One tile of one render target while it is blended: the CPU's counterpart of on-chip memory.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "cpu/rows/tile_spans.h"
#include "cpu/run_state.h"
#include "cpu/shading/shade_kernels.h"
#include "shaders/blend_ops.h"

namespace voxelpipe::cpu {

// A fragment's output converted for blending (blend_ops.h); shared by all voxels with the same shader output.
struct BlendValue {
  int32_t cell[4];  // in the order of TileBuffer's cells
  int64_t term[4];
  bool bit;
};

// Local voxel of a tile: x + 32*(y + 8*z); row r = y + 8*z is one word of bits.
class TileBuffer {
 public:
  explicit TileBuffer(const CpuTarget& target);

  // Discards the previous tile. The values of a row are initialized when a fragment first touches it.
  void Begin() { presence_.fill(0); }

  BlendValue Convert(const FragmentOutput& out) const;

  // Blends one fragment into each voxel of a span. Fragments of a voxel arrive by ascending triangle id; where parts
  // are filled by ascending rank of their part, and then `first` looks at the triangle's id. `rank`: PartView::rank.
  void Blend(TileSpan span, const BlendValue& value, uint32_t triangle, uint32_t rank = 0);
  // Blends a value into the voxels of a row that are in `mask` and have no fragment yet; for `replace` and `first`. The
  // values of the row's other voxels stay undefined until they have a fragment.
  void BlendUntaken(int row, uint32_t mask, const BlendValue& value, uint32_t rank);
  // Blends the fragments of a batch in its order, those that are not discarded. `untaken`: as BlendUntaken.
  void BlendBatch(const ShadeKernels& kernels, const FragmentBatch& batch, const ShadedBatch& shaded, bool untaken);
  // Only for targets that hold the owner's fragment alone: takes out the fragments of a row's voxels in whose place
  // there is a higher rank in `ranks`.
  void DropBelow(int row, std::span<const uint16_t> ranks);

  // Writes the tile to the dense target: values where there is a fragment, the clear value elsewhere; and the bits of
  // bit targets and presence to their grids. `range` is the tile clipped to the grid. After the last tile, StreamFence.
  void Store(const RunState& state, const VoxelRange& range, CpuTarget& target) const;
  void StoreBitGrids(const RunState& state, const VoxelRange& range, CpuTarget& target) const;

  // The stored bits (blend_ops.h) of component c of the voxels of a row that are in `mask`, all of them with a
  // fragment; 0 or 1 for a bit target. Other elements of `out`, which has 32, are not changed.
  void StoredRow(int row, int c, uint32_t mask, uint32_t* out) const;
  uint32_t presence(int row) const { return presence_[size_t(row)]; }

 private:
  enum class Kept : uint8_t { kBits, kCells, kSums, kCounts, kAverages };

  void BeginRow(int row);
  // Of the voxels from first to last.
  void KeepRanks(int first, int last, uint32_t rank);
  ConversionRules Rules() const;
  // Calls visit(i, place, present) for each fragment of a batch that is blended; `present`: the voxel has one already.
  template <typename Visit>
  void ForEachBlended(const FragmentBatch& batch, const ShadedBatch& shaded, bool untaken, const Visit& visit);
  // For `first`: true if a fragment is the first of its voxel so far.
  bool IsFirst(const FragmentBatch& batch, int i, uint32_t place, bool present);
  template <int kComponents>
  void BlendCells(const FragmentBatch& batch, const ShadedBatch& shaded, const BatchCells& cells, bool untaken);
  template <int kComponents>
  void AddTerms(const FragmentBatch& batch, const ShadedBatch& shaded, const BatchTerms& terms);
  // Of the voxels in `mask`, those in which the triangle is the first so far.
  uint32_t FirstIn(int row, uint32_t mask, uint32_t before, uint32_t triangle);
  template <typename Update>
  void UpdateCells(TileSpan span, const BlendValue& value, const Update& update);
  template <typename Element>
  void StoreElements(const RunState& state, const VoxelRange& range, CpuTarget& target) const;
  void StoreWords(const RunState& state, const VoxelRange& range, BitGrid& grid,
                  const std::array<uint32_t, kTileRows>& words) const;

  TargetSpec spec_;
  VoxelFormat format_;  // KeptFormat of it
  bool u32_output_;
  double scale_;
  Kept kept_;
  uint32_t flip_positive_ = 0, flip_negative_ = 0;  // XOR masks between a cell of blend_ops.h and the stored cell
  int32_t begin_cell_ = 0;
  uint32_t begin_bits_ = 0;
  std::array<uint32_t, kTileRows> presence_{};
  std::array<uint32_t, kTileRows> bits_{};  // kBits
  // Planar: all voxels of one component after the other.
  std::vector<int32_t> cells_;    // kCells: for min and max in an encoding that orders as signed integers
  std::vector<int64_t> sums_;     // kSums, kAverages
  std::vector<uint32_t> counts_;  // kCounts, kAverages: one a voxel
  std::vector<uint16_t> ranks_;   // of_owner: of each voxel the rank of the fragment that it holds
  std::vector<uint32_t> ids_;     // `first` where triangles do not come by id: of each voxel the first one so far
};

}  // namespace voxelpipe::cpu
