#include "cpu/tile_buffer.h"

#include <bit>

namespace voxelpipe::cpu {

TileBuffer::TileBuffer(const CpuTarget& target)
    : spec_(target.spec),
      u32_output_(target.u32_output),
      is_float_(spec_.format == VoxelFormat::kF16 || spec_.format == VoxelFormat::kF32),
      scale_(target.scale) {
  const size_t count = size_t{kTileVoxels} * size_t(spec_.components);
  if (spec_.format == VoxelFormat::kBit) {
    kept_ = Kept::kBits;
  } else if (spec_.blend == Blend::kCount) {
    kept_ = Kept::kCounts;
    counts_.resize(kTileVoxels);
  } else if (spec_.blend == Blend::kAverage) {
    kept_ = Kept::kAverages;
    counts_.resize(kTileVoxels);
    sums_.resize(count);
  } else if (spec_.blend == Blend::kAdd) {
    kept_ = Kept::kSums;
    sums_.resize(count);
  } else {
    kept_ = Kept::kCells;
    cells_.resize(count);
  }
}

void TileBuffer::Blend(int row, int bit, const FragmentOutput& out) {
  const uint32_t mask = 1u << bit;
  const bool first = (presence_[size_t(row)] & mask) == 0;
  presence_[size_t(row)] |= mask;
  const size_t voxel = size_t(row * 32 + bit), components = size_t(spec_.components), at = voxel * components;
  switch (kept_) {
    case Kept::kBits: {
      const bool v = spec_.blend == Blend::kCount || ToBit(out, u32_output_);
      const bool now = first ? v : BlendBit(spec_.blend, (bits_[size_t(row)] & mask) != 0, v);
      bits_[size_t(row)] = now ? bits_[size_t(row)] | mask : bits_[size_t(row)] & ~mask;
      break;
    }
    case Kept::kCells:
      for (size_t c = 0; c < components; ++c) {
        const uint32_t v = ToCell(out, u32_output_, int(c), spec_.format, scale_);
        cells_[at + c] = first ? v : BlendCell(spec_.blend, is_float_, cells_[at + c], v);
      }
      break;
    case Kept::kAverages: counts_[voxel] = first ? 1 : counts_[voxel] + 1; [[fallthrough]];
    case Kept::kSums:
      for (size_t c = 0; c < components; ++c) {
        const int64_t v = ToTerm(out, u32_output_, int(c), spec_.format, scale_, spec_.quantum);
        sums_[at + c] = first ? v : sums_[at + c] + v;
      }
      break;
    case Kept::kCounts: counts_[voxel] = first ? 1 : counts_[voxel] + 1; break;
  }
}

uint32_t TileBuffer::StoredAt(int voxel, int c) const {
  const size_t at = size_t(voxel) * size_t(spec_.components) + size_t(c);
  switch (kept_) {
    case Kept::kBits: return bits_[size_t(voxel / 32)] >> (voxel % 32) & 1;
    case Kept::kCells: return StoredBits(cells_[at], spec_.format);
    case Kept::kSums: return StoreSum(sums_[at], spec_.format, spec_.quantum);
    case Kept::kCounts: return StoreCount(counts_[size_t(voxel)], spec_.format);
    case Kept::kAverages: return StoreAverage(sums_[at], counts_[size_t(voxel)], spec_.format, spec_.quantum);
  }
  return 0;
}

void TileBuffer::StoreWords(const RunState& state, const VoxelRange& range, BitGrid& grid,
                            const std::array<uint32_t, kTileRows>& words) const {
  const int64_t word = range.begin[0] / 32;
  for (int64_t z = range.begin[2]; z < range.end[2]; ++z) {
    for (int64_t y = range.begin[1]; y < range.end[1]; ++y) {
      grid.row(state.SlabRow(y, z))[size_t(word)] = words[size_t((y - range.begin[1]) + 8 * (z - range.begin[2]))];
    }
  }
}

void TileBuffer::StoreBitGrids(const RunState& state, const VoxelRange& range, CpuTarget& target) const {
  if (target.own_presence) StoreWords(state, range, target.presence, presence_);
  if (!target.bits.empty()) StoreWords(state, range, target.bits, bits_);
}

template <typename Element>
void TileBuffer::StoreElements(const RunState& state, const VoxelRange& range, CpuTarget& target) const {
  auto* const out = reinterpret_cast<Element*>(target.dense.data());
  const bool planar = state.request.request.layout == Layout::kPlanar;
  const uint64_t components = uint64_t(spec_.components), voxels = state.slab_voxels();
  for (int row = 0; row < kTileRows; ++row) {
    const int64_t y = range.begin[1] + row % 8, z = range.begin[2] + row / 8;
    const uint64_t first = uint64_t(range.begin[0]) + uint64_t(state.dims[0]) * uint64_t(state.SlabRow(y, z));
    for (uint32_t left = presence_[size_t(row)]; left != 0; left &= left - 1) {
      const int bit = std::countr_zero(left);
      const uint64_t n = first + uint64_t(bit);
      for (uint64_t c = 0; c < components; ++c) {
        out[planar ? c * voxels + n : n * components + c] = Element(StoredAt(row * 32 + bit, int(c)));
      }
    }
  }
}

void TileBuffer::Store(const RunState& state, const VoxelRange& range, CpuTarget& target) const {
  StoreBitGrids(state, range, target);
  switch (BitsPerComponent(spec_.format)) {
    case 8: return StoreElements<uint8_t>(state, range, target);
    case 16: return StoreElements<uint16_t>(state, range, target);
    case 32: return StoreElements<uint32_t>(state, range, target);
    default: return;  // bits are stored
  }
}

}  // namespace voxelpipe::cpu
