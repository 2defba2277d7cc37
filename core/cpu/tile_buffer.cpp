#include "cpu/tile_buffer.h"

#include <bit>

namespace voxelpipe::cpu {

TileBuffer::TileBuffer(const CpuTarget& target) : spec_(target.spec), u32_output_(target.u32_output) {
  if (spec_.format == VoxelFormat::kBit) return;
  const size_t count = size_t{kTileVoxels} * size_t(spec_.components);
  if (spec_.blend == Blend::kAdd) {
    sums_.resize(count);
  } else {
    values_.resize(count);
  }
}

void TileBuffer::Blend(int row, int bit, const FragmentOutput& out) {
  const uint32_t mask = 1u << bit;
  const bool first = (presence_[row] & mask) == 0;
  presence_[row] |= mask;
  if (spec_.format == VoxelFormat::kBit) {
    const bool value = ToBit(out, u32_output_);
    const bool keep = spec_.blend == Blend::kOr && !first && (bits_[row] & mask) != 0;
    bits_[row] = value || keep ? bits_[row] | mask : bits_[row] & ~mask;
    return;
  }
  const size_t at = size_t(row * 32 + bit) * size_t(spec_.components);
  for (int i = 0; i < spec_.components; ++i) {
    const float v = ToF32(out, u32_output_, i);
    switch (spec_.blend) {
      case Blend::kAdd: sums_[at + i] = (first ? 0 : sums_[at + i]) + Quantize(v, spec_.quantum); break;
      case Blend::kMin: values_[at + i] = first ? v : BlendMin(values_[at + i], v); break;
      case Blend::kMax: values_[at + i] = first ? v : BlendMax(values_[at + i], v); break;
      case Blend::kReplace:  // ascending ids: the last one is the largest
      default:               // the other blends come with the other formats
        values_[at + i] = v;
        break;
    }
  }
}

float TileBuffer::ValueAt(int voxel, int component) const {
  const size_t at = size_t(voxel) * size_t(spec_.components) + size_t(component);
  return spec_.blend == Blend::kAdd ? Dequantize(sums_[at], spec_.quantum) : values_[at];
}

void TileBuffer::StoreBits(const RunState& state, const VoxelRange& range, BitGrid& grid,
                           const std::array<uint32_t, kTileRows>& words) const {
  const int64_t word = range.begin[0] / 32;
  for (int64_t z = range.begin[2]; z < range.end[2]; ++z) {
    for (int64_t y = range.begin[1]; y < range.end[1]; ++y) {
      grid.row(state.SlabRow(y, z))[word] = words[size_t((y - range.begin[1]) + 8 * (z - range.begin[2]))];
    }
  }
}

void TileBuffer::Store(const RunState& state, const VoxelRange& range, CpuTarget& target) const {
  if (target.own_presence) StoreBits(state, range, target.presence, presence_);
  if (spec_.format == VoxelFormat::kBit) {
    if (!target.is_occupancy) StoreBits(state, range, target.bits, bits_);
    return;
  }
  float* out = reinterpret_cast<float*>(target.dense.data());
  const bool planar = state.request.request.layout == Layout::kPlanar;
  const uint64_t components = uint64_t(spec_.components), voxels = state.slab_voxels();
  for (int row = 0; row < kTileRows; ++row) {
    const int64_t y = range.begin[1] + row % 8, z = range.begin[2] + row / 8;
    const uint64_t first = uint64_t(range.begin[0]) + uint64_t(state.dims[0]) * uint64_t(state.SlabRow(y, z));
    for (uint32_t left = presence_[row]; left != 0; left &= left - 1) {
      const int bit = std::countr_zero(left);
      const uint64_t n = first + uint64_t(bit);
      for (uint64_t c = 0; c < components; ++c) {
        out[planar ? c * voxels + n : n * components + c] = ValueAt(row * 32 + bit, int(c));
      }
    }
  }
}

}  // namespace voxelpipe::cpu
