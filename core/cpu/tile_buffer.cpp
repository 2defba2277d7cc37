#include "cpu/tile_buffer.h"

#include <algorithm>
#include <bit>
#include <climits>

#include "cpu/base/stream.h"

namespace voxelpipe::cpu {
namespace {

// Calls visit(bit) for each set bit.
template <typename Visit>
void ForEachBit(uint32_t mask, const Visit& visit) {
  for (; mask != 0; mask &= mask - 1) visit(std::countr_zero(mask));
}

// Calls visit(first, end) for each run of set bits, first <= bit < end.
template <typename Visit>
void ForEachRun(uint32_t mask, const Visit& visit) {
  for (int at = 0; at < 32 && mask >> at != 0;) {
    const int first = at + std::countr_zero(mask >> at);
    at = first + std::countr_one(mask >> first);
    visit(first, at);
  }
}

}  // namespace

TileBuffer::TileBuffer(const CpuTarget& target)
    : spec_(target.spec), format_(target.kept_format), u32_output_(target.u32_output), scale_(target.scale) {
  const size_t count = size_t{kTileVoxels} * size_t(spec_.components);
  if (spec_.blend == Blend::kFirst && target.ids_unordered) ids_.resize(kTileVoxels);
  if (target.of_owner) ranks_.resize(kTileVoxels);
  if (spec_.format == VoxelFormat::kBit) {
    kept_ = Kept::kBits;
    begin_bits_ = spec_.blend == Blend::kAnd ? ~0u : 0;
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
    if (spec_.blend == Blend::kMin || spec_.blend == Blend::kMax) {
      // Order-preserving encoding: float bits, with all but the sign inverted for negative floats, compare as
      // OrderedLess does.
      flip_negative_ = IsInteger(spec_.format) ? 1u << 31 : ~0u >> 1;
      flip_positive_ = IsInteger(spec_.format) ? 1u << 31 : 0;
      begin_cell_ = spec_.blend == Blend::kMin ? INT_MAX : INT_MIN;
    }
    if (spec_.blend == Blend::kAnd) begin_cell_ = -1;
  }
}

BlendValue TileBuffer::Convert(const FragmentOutput& out) const {
  BlendValue value;
  switch (kept_) {
    case Kept::kBits: value.bit = spec_.blend == Blend::kCount || ToBit(out, u32_output_); break;
    case Kept::kCells:
      for (int c = 0; c < spec_.components; ++c) {
        const uint32_t cell = ToCell(out, u32_output_, c, format_, scale_);
        value.cell[c] = int32_t(cell ^ (int32_t(cell) < 0 ? flip_negative_ : flip_positive_));
      }
      break;
    case Kept::kSums:
    case Kept::kAverages:
      for (int c = 0; c < spec_.components; ++c) {
        value.term[c] = ToTerm(out, u32_output_, c, format_, scale_, spec_.quantum);
      }
      break;
    case Kept::kCounts: break;
  }
  return value;
}

void TileBuffer::BeginRow(int row) {
  bits_[size_t(row)] = begin_bits_;
  for (int c = 0; c < spec_.components; ++c) {
    const int64_t at = int64_t{c} * kTileVoxels + row * 32;
    if (kept_ == Kept::kCells) std::fill_n(cells_.begin() + at, 32, begin_cell_);
    if (kept_ == Kept::kSums || kept_ == Kept::kAverages) std::fill_n(sums_.begin() + at, 32, 0);
  }
  if (kept_ == Kept::kCounts || kept_ == Kept::kAverages) std::fill_n(counts_.begin() + row * 32, 32, 0u);
}

template <typename Update>
void TileBuffer::UpdateCells(TileSpan span, const BlendValue& value, const Update& update) {
  const int first = span.row() * 32 + span.first(), last = span.row() * 32 + span.last();
  for (int c = 0; c < spec_.components; ++c) {
    int32_t* const cells = cells_.data() + c * kTileVoxels;
    const int32_t v = value.cell[c];
    for (int i = first; i <= last; ++i) cells[i] = update(cells[i], v);
  }
}

uint32_t TileBuffer::FirstIn(int row, uint32_t mask, uint32_t before, uint32_t triangle) {
  uint32_t first = mask & ~before;
  if (ids_.empty()) return first;
  uint32_t* const ids = ids_.data() + row * 32;
  ForEachBit(mask & before, [&](int bit) { first |= uint32_t(triangle < ids[bit]) << bit; });
  ForEachBit(first, [&](int bit) { ids[bit] = triangle; });
  return first;
}

void TileBuffer::DropBelow(int row, std::span<const uint16_t> ranks) {
  uint32_t& presence = presence_[size_t(row)];
  const uint16_t* const own = ranks_.data() + row * 32;
  ForEachBit(presence, [&](int bit) { presence &= ~(uint32_t(ranks[size_t(bit)] > own[bit]) << bit); });
}

// Apart: it would cost all other blends some registers.
[[gnu::noinline]] void TileBuffer::KeepRanks(int first, int last, uint32_t rank) {
  std::fill(ranks_.begin() + first, ranks_.begin() + last + 1, uint16_t(rank));
}

void TileBuffer::Blend(TileSpan span, const BlendValue& value, uint32_t triangle, uint32_t rank) {
  const int row = span.row();
  const uint32_t mask = span.mask(), before = presence_[size_t(row)];
  if (before == 0) BeginRow(row);
  presence_[size_t(row)] = before | mask;
  const int first = row * 32 + span.first(), last = row * 32 + span.last();
  if (!ranks_.empty()) [[unlikely]]
    KeepRanks(first, last, rank);
  switch (kept_) {
    case Kept::kBits: {
      uint32_t& bits = bits_[size_t(row)];
      if (spec_.blend == Blend::kReplace) bits &= ~mask;
      if (spec_.blend == Blend::kAnd) {
        if (!value.bit) bits &= ~mask;
      } else if (spec_.blend == Blend::kFirst) {
        const uint32_t first_in = FirstIn(row, mask, before, triangle);
        bits = value.bit ? bits | first_in : bits & ~first_in;
      } else if (value.bit) {
        bits |= mask;
      }
      break;
    }
    case Kept::kCells:
      switch (spec_.blend) {
        case Blend::kReplace: return UpdateCells(span, value, [](int32_t, int32_t v) { return v; });
        case Blend::kMin: return UpdateCells(span, value, [](int32_t kept, int32_t v) { return std::min(kept, v); });
        case Blend::kMax: return UpdateCells(span, value, [](int32_t kept, int32_t v) { return std::max(kept, v); });
        case Blend::kOr: return UpdateCells(span, value, [](int32_t kept, int32_t v) { return kept | v; });
        case Blend::kAnd: return UpdateCells(span, value, [](int32_t kept, int32_t v) { return kept & v; });
        default: {  // first
          const uint32_t first_in = FirstIn(row, mask, before, triangle);
          for (int c = 0; c < spec_.components; ++c) {
            int32_t* const cells = cells_.data() + c * kTileVoxels + row * 32;
            ForEachBit(first_in, [&](int bit) { cells[bit] = value.cell[c]; });
          }
          return;
        }
      }
    case Kept::kAverages:
      for (int i = first; i <= last; ++i) ++counts_[size_t(i)];
      [[fallthrough]];
    case Kept::kSums:
      for (int c = 0; c < spec_.components; ++c) {
        int64_t* const sums = sums_.data() + c * kTileVoxels;
        const int64_t v = value.term[c];
        for (int i = first; i <= last; ++i) sums[i] += v;
      }
      break;
    case Kept::kCounts:
      for (int i = first; i <= last; ++i) ++counts_[size_t(i)];
      break;
  }
}

void TileBuffer::BlendUntaken(int row, uint32_t mask, const BlendValue& value, uint32_t rank) {
  uint32_t& presence = presence_[size_t(row)];
  mask &= ~presence;
  presence |= mask;
  if (kept_ == Kept::kBits) {
    uint32_t& bits = bits_[size_t(row)];
    bits = value.bit ? bits | mask : bits & ~mask;
  } else {
    for (int c = 0; c < spec_.components; ++c) {
      int32_t* const cells = cells_.data() + c * kTileVoxels + row * 32;
      ForEachBit(mask, [&](int bit) { cells[bit] = value.cell[c]; });
    }
  }
  if (!ranks_.empty()) ForEachBit(mask, [&](int bit) { KeepRanks(row * 32 + bit, row * 32 + bit, rank); });
}

ConversionRules TileBuffer::Rules() const {
  return {format_, u32_output_, spec_.components, scale_, spec_.quantum};
}

template <typename Visit>
void TileBuffer::ForEachBlended(const FragmentBatch& batch, const ShadedBatch& shaded, bool untaken,
                                const Visit& visit) {
  for (int i = 0; i < batch.count; ++i) {
    if (shaded.discard[i] != 0) continue;
    const uint32_t place = batch.place[i], row = place / 32;
    const uint32_t bit = 1u << (place % 32), before = presence_[row];
    const bool present = (before & bit) != 0;
    if (untaken && present) continue;
    if (before == 0) BeginRow(int(row));
    presence_[row] = before | bit;
    if (!ranks_.empty()) KeepRanks(int(place), int(place), batch.part->rank);
    visit(i, place, present);
  }
}

template <int kComponents>
void TileBuffer::BlendCells(const FragmentBatch& batch, const ShadedBatch& shaded, const BatchCells& cells,
                            bool untaken) {
  const auto update = [&](const auto& blend) {
    ForEachBlended(batch, shaded, untaken, [&](int i, uint32_t place, bool) {
      for (int c = 0; c < kComponents; ++c) {
        int32_t& cell = cells_[uint32_t(c) * kTileVoxels + place];
        const auto v = int32_t(cells[c][i]);
        cell = blend(cell, int32_t(cells[c][i] ^ (v < 0 ? flip_negative_ : flip_positive_)));
      }
    });
  };
  switch (spec_.blend) {
    case Blend::kReplace: return update([](int32_t, int32_t v) { return v; });
    case Blend::kMin: return update([](int32_t kept, int32_t v) { return std::min(kept, v); });
    case Blend::kMax: return update([](int32_t kept, int32_t v) { return std::max(kept, v); });
    case Blend::kOr: return update([](int32_t kept, int32_t v) { return kept | v; });
    case Blend::kAnd: return update([](int32_t kept, int32_t v) { return kept & v; });
    default:  // first
      return ForEachBlended(batch, shaded, untaken, [&](int i, uint32_t place, bool present) {
        if (!IsFirst(batch, i, place, present)) return;
        for (int c = 0; c < kComponents; ++c) cells_[uint32_t(c) * kTileVoxels + place] = int32_t(cells[c][i]);
      });
  }
}

template <int kComponents>
void TileBuffer::AddTerms(const FragmentBatch& batch, const ShadedBatch& shaded, const BatchTerms& terms) {
  const auto add = [&](int i, uint32_t place) {
    for (int c = 0; c < kComponents; ++c) sums_[uint32_t(c) * kTileVoxels + place] += terms[c][i];
  };
  if (kept_ == Kept::kSums) {
    return ForEachBlended(batch, shaded, false, [&](int i, uint32_t place, bool) { add(i, place); });
  }
  ForEachBlended(batch, shaded, false, [&](int i, uint32_t place, bool) {
    ++counts_[place];
    add(i, place);
  });
}

bool TileBuffer::IsFirst(const FragmentBatch& batch, int i, uint32_t place, bool present) {
  if (ids_.empty()) return !present;
  const uint32_t id = batch.triangle[batch.triangle_of[i]] + batch.part->id_offset;
  if (present && id >= ids_[place]) return false;
  ids_[place] = id;
  return true;
}

void TileBuffer::BlendBatch(const ShadeKernels& kernels, const FragmentBatch& batch, const ShadedBatch& shaded,
                            bool untaken) {
  switch (kept_) {
    case Kept::kBits:
      return ForEachBlended(batch, shaded, untaken, [&](int i, uint32_t place, bool present) {
        const bool bit = spec_.blend == Blend::kCount || ToBit(OutputOf(shaded, u32_output_, i), u32_output_);
        if (spec_.blend == Blend::kFirst && !IsFirst(batch, i, place, present)) return;
        uint32_t& bits = bits_[place / 32];
        const uint32_t mask = 1u << (place % 32);
        const bool kept = spec_.blend == Blend::kFirst ? bit : BlendBit(spec_.blend, (bits & mask) != 0, bit);
        bits = kept ? bits | mask : bits & ~mask;
      });
    case Kept::kCells: {
      BatchCells cells;
      kernels.to_cells(shaded, batch.count, Rules(), cells);
      switch (spec_.components) {
        case 1: return BlendCells<1>(batch, shaded, cells, untaken);
        case 2: return BlendCells<2>(batch, shaded, cells, untaken);
        case 3: return BlendCells<3>(batch, shaded, cells, untaken);
        default: return BlendCells<4>(batch, shaded, cells, untaken);
      }
    }
    case Kept::kCounts:
      return ForEachBlended(batch, shaded, untaken, [&](int, uint32_t place, bool) { ++counts_[place]; });
    case Kept::kSums:
    case Kept::kAverages: {
      BatchTerms terms;
      kernels.to_terms(shaded, batch.count, Rules(), terms);
      switch (spec_.components) {
        case 1: return AddTerms<1>(batch, shaded, terms);
        case 2: return AddTerms<2>(batch, shaded, terms);
        case 3: return AddTerms<3>(batch, shaded, terms);
        default: return AddTerms<4>(batch, shaded, terms);
      }
    }
  }
}

void TileBuffer::StoredRow(int row, int c, uint32_t mask, uint32_t* out) const {
  const int first = row * 32;
  const int64_t at = int64_t{c} * kTileVoxels + first;
  switch (kept_) {
    case Kept::kBits: return ForEachBit(mask, [&](int bit) { out[bit] = bits_[size_t(row)] >> bit & 1; });
    case Kept::kCells: {
      const int32_t* const cells = cells_.data() + at;
      const auto cell = [&](int bit) {
        return uint32_t(cells[bit]) ^ (cells[bit] < 0 ? flip_negative_ : flip_positive_);
      };
      if (spec_.format == VoxelFormat::kF16) {
        return ForEachBit(mask, [&](int bit) { out[bit] = StoredBits(cell(bit), VoxelFormat::kF16); });
      }
      return ForEachRun(mask, [&](int begin, int end) {
        for (int i = begin; i < end; ++i) out[i] = cell(i);
      });
    }
    case Kept::kSums:
      return ForEachBit(mask,
                        [&](int bit) { out[bit] = StoreSum(sums_[size_t(at + bit)], format_, spec_.quantum, c); });
    case Kept::kCounts:
      return ForEachBit(mask,
                        [&](int bit) { out[bit] = StoreCount(counts_[size_t(first) + size_t(bit)], spec_.format); });
    case Kept::kAverages:
      return ForEachBit(mask, [&](int bit) {
        out[bit] =
            StoreAverage(sums_[size_t(at + bit)], counts_[size_t(first) + size_t(bit)], format_, spec_.quantum, c);
      });
  }
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
  if (!target.bits.empty()) {
    std::array<uint32_t, kTileRows> words;  // a row without fragments holds the bits of an earlier tile
    for (size_t row = 0; row < words.size(); ++row) words[row] = bits_[row] & presence_[row];
    StoreWords(state, range, target.bits, words);
  }
}

template <typename Element>
void TileBuffer::StoreElements(const RunState& state, const VoxelRange& range, CpuTarget& target) const {
  auto* const out = reinterpret_cast<Element*>(target.dense.data());
  const int components = spec_.components;
  const bool planar = state.request.request.layout == Layout::kPlanar || components == 1;
  const int arrays = planar ? components : 1, stride = planar ? 1 : components;
  const int64_t width = range.end[0] - range.begin[0], row_bytes = width * stride * int64_t(sizeof(Element));
  const bool streams = target.streams();
  const ElementPattern clear(target.clear_stored, sizeof(Element), streams && row_bytes % kLineBytes == 0);
  for (int64_t z = range.begin[2]; z < range.end[2]; ++z) {
    for (int64_t y = range.begin[1]; y < range.end[1]; ++y) {
      const int row = int((y - range.begin[1]) + 8 * (z - range.begin[2]));
      const uint32_t mask = presence_[size_t(row)];
      const uint64_t first = uint64_t(range.begin[0]) + uint64_t(state.dims[0]) * uint64_t(state.SlabRow(y, z));
      for (int array = 0; array < arrays; ++array) {
        auto* const to =
            reinterpret_cast<uint8_t*>(out + uint64_t(array) * state.slab_voxels() + first * uint64_t(stride));
        if (mask == 0) {
          clear.Fill(to, row_bytes);
          continue;
        }
        Element line[32 * 4];
        std::fill_n(line, width * stride, Element(target.clear_stored));
        if constexpr (sizeof(Element) == sizeof(uint32_t)) {
          if (stride == 1) {
            StoredRow(row, array, mask, line);
            StreamCopy(to, line, row_bytes, streams);
            continue;
          }
        }
        for (int c = 0; c < stride; ++c) {
          uint32_t stored[32];
          StoredRow(row, array + c, mask, stored);
          ForEachBit(mask, [&](int bit) { line[bit * stride + c] = Element(stored[bit]); });
        }
        StreamCopy(to, line, row_bytes, streams);
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
