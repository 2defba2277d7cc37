#include "cpu/sparse.h"

#include <algorithm>
#include <bit>
#include <cstring>

#include "base/parallel.h"
#include "cpu/base/element_store.h"
#include "pipeline/plan/list_memory.h"

namespace voxelpipe::cpu {
namespace {

constexpr uint64_t kMinChunkBytes = 256 << 10, kMaxChunkBytes = 4 << 20;
constexpr int64_t kBrick = 8;  // voxels along each axis
constexpr uint64_t kMaskBytes = kBrick * kBrick * kBrick / 8;

// Bytes of one voxel's value in TileValues.
uint64_t KeptBytes(const CpuTarget& target) {
  if (target.is_occupancy) return 0;
  return target.spec.format == VoxelFormat::kBit
             ? 1
             : uint64_t(target.spec.components * BitsPerComponent(target.spec.format) / 8);
}

// The bricks of one row along x, and the offset of the row in each array.
struct BrickRow {
  uint64_t bricks = 0, voxels = 0;
};

class BrickMaker {
 public:
  explicit BrickMaker(const RunState& state)
      : state_(state),
        nx_((state.dims[0] + kBrick - 1) / kBrick),
        ny_((state.dims[1] + kBrick - 1) / kBrick),
        nz_((state.slab_dims[2] + kBrick - 1) / kBrick) {}

  absl::StatusOr<ResultArrays> Make() {
    rows_.resize(size_t(ny_ * nz_));
    absl::Status s = ParallelChunks(ny_ * nz_, 4, state_.job, [&](int64_t begin, int64_t end) {
      for (int64_t r = begin; r < end; ++r) {
        ForEachBrick(r, [&](int64_t, const std::array<uint8_t, kMaskBytes>& mask) {
          ++rows_[size_t(r)].bricks;
          rows_[size_t(r)].voxels += Count(mask);
        });
      }
    });
    if (!s.ok()) return s;
    BrickRow total;
    for (BrickRow& row : rows_) {
      const BrickRow here = row;
      row = total;
      total.bricks += here.bricks;
      total.voxels += here.voxels;
    }
    if (s = Allocate(total); !s.ok()) return s;
    s = ParallelChunks(ny_ * nz_, 4, state_.job, [&](int64_t begin, int64_t end) {
      for (int64_t r = begin; r < end; ++r) Emit(r, total.bricks, total.voxels);
    });
    if (!s.ok()) return s;
    return std::move(out_);
  }

 private:
  static uint64_t Count(const std::array<uint8_t, kMaskBytes>& mask) {
    uint64_t count = 0;
    for (const uint8_t byte : mask) count += uint64_t(std::popcount(byte));
    return count;
  }

  // True if word w of brick row r is known to have neither a fragment nor fill without reading its bits.
  bool IsEmptyTile(int64_t r, int64_t w) const {
    if (state_.slab_tiles.empty() || !state_.inside.empty()) return false;
    return state_.slab_tiles[size_t(w + state_.tiles.dims[0] * r)] ==
           UINT32_MAX;  // tiles are as deep and as high as bricks
  }

  // Bits of slab row `row`, word w, that are occupied.
  uint32_t Word(int64_t row, int64_t w) const {
    const uint32_t covered = state_.coverage.row(row)[size_t(w)];
    return state_.inside.empty() ? covered : covered | state_.inside.row(row)[size_t(w)];
  }

  // True if rows [y0, y1) of slices [z0, z1) hold no occupied voxel; false also if the tiles tell where bricks are.
  // Most rows of a large grid are empty, and a row's words are contiguous: one pass over them is the quickest answer.
  bool IsEmptyRow(int64_t y0, int64_t y1, int64_t z0, int64_t z1) const {
    if (!state_.slab_tiles.empty() && state_.inside.empty()) return false;
    uint32_t any = 0;
    for (int64_t z = z0; z < z1; ++z) {
      for (int64_t y = y0; y < y1; ++y) {
        const int64_t row = y + state_.dims[1] * z;
        for (const uint32_t word : state_.coverage.row(row)) any |= word;
        if (state_.inside.empty()) continue;
        for (const uint32_t word : state_.inside.row(row)) any |= word;
      }
      if (any != 0) return false;
    }
    return true;
  }

  // Calls visit(bx, mask) for each brick of brick row r with an occupied voxel.
  template <typename Visit>
  void ForEachBrick(int64_t r, const Visit& visit) const {
    const int64_t y0 = r % ny_ * kBrick, z0 = r / ny_ * kBrick;  // z within the slab
    const int64_t y1 = std::min(state_.dims[1], y0 + kBrick), z1 = std::min(state_.slab_dims[2], z0 + kBrick);
    if (IsEmptyRow(y0, y1, z0, z1)) return;
    for (int64_t w = 0; w < state_.coverage.words_per_row(); ++w) {
      if (IsEmptyTile(r, w)) continue;
      std::array<uint32_t, kTileRows> words{};
      uint32_t any = 0;
      for (int64_t z = z0; z < z1; ++z) {
        for (int64_t y = y0; y < y1; ++y) {
          const uint32_t word = Word(y + state_.dims[1] * z, w);
          words[size_t((y - y0) + kBrick * (z - z0))] = word;
          any |= word;
        }
      }
      for (int64_t part = 0; part < 4; ++part) {
        if ((any >> (8 * part) & 0xff) == 0) continue;
        std::array<uint8_t, kMaskBytes> mask;
        for (size_t i = 0; i < kMaskBytes; ++i) mask[i] = uint8_t(words[i] >> (8 * part));
        visit(w * 4 + part, mask);
      }
    }
  }

  absl::Status Allocate(const BrickRow& total) {
    VoxelizeRequest request = state_.request.request;
    const ResultHeader header = MakeResultHeader(request, state_.grid, total.bricks, total.voxels, 0);
    if (state_.lists != nullptr) {
      if (absl::Status full = state_.lists->Need(state_.kept_bytes + BytesOf(header)); !full.ok()) return full;
    }
    absl::StatusOr<VoxelizeResult> arrays = AllocateResult(header);
    if (!arrays.ok()) return arrays.status();
    out_ = std::move(static_cast<ResultArrays&>(*arrays));
    for (size_t t = 0; t < out_.targets.size(); ++t) {
      if (state_.targets[t].spec.format == VoxelFormat::kBit) {
        std::fill_n(out_.targets[t].data(), out_.targets[t].size(), uint8_t{0});
      }
    }
    return absl::OkStatus();
  }

  void Emit(int64_t r, uint64_t all_bricks, uint64_t all_voxels) {
    BrickRow at = rows_[size_t(r)];
    if (at.bricks == (size_t(r) + 1 < rows_.size() ? rows_[size_t(r) + 1].bricks : all_bricks)) return;  // has none
    const int64_t by = r % ny_, bz = r / ny_ + state_.slab.begin / kBrick;
    ForEachBrick(r, [&](int64_t bx, const std::array<uint8_t, kMaskBytes>& mask) {
      const uint64_t id = uint64_t(bx + nx_ * (by + ny_ * bz));
      std::memcpy(out_.bricks.data() + at.bricks * sizeof id, &id, sizeof id);
      std::memcpy(out_.masks.data() + at.bricks * kMaskBytes, mask.data(), kMaskBytes);
      for (size_t t = 0; t < state_.targets.size(); ++t) EmitValues(t, r, bx, mask, at.voxels, all_voxels);
      ++at.bricks;
      at.voxels += Count(mask);
    });
  }

  // Writes the values of one target in one brick; `first` is the index of its first value.
  void EmitValues(size_t t, int64_t r, int64_t bx, const std::array<uint8_t, kMaskBytes>& mask, uint64_t first,
                  uint64_t all_voxels) {
    const CpuTarget& target = state_.targets[t];
    const TileValues* const tile = Tile(r, bx);
    const int components = target.spec.components, bits = BitsPerComponent(target.spec.format);
    const bool planar = state_.request.request.layout == Layout::kPlanar;
    const uint64_t kept = KeptBytes(target);
    const uint8_t* values = nullptr;
    uint64_t rank = 0;  // of the row's first voxel among the tile's listed ones
    if (tile != nullptr && kept > 0) {
      values = tile->data;
      uint64_t listed = 0;
      for (const uint32_t word : tile->covered) listed += uint64_t(std::popcount(word));
      for (size_t before = 0; before < t; ++before) values += listed * KeptBytes(state_.targets[before]);
    }
    uint64_t n = first;
    if (kept > 0 && bits != 1 && (components == 1 || !planar) && !target.own_presence && state_.inside.empty()) {
      // Every voxel of the brick has a value, and the values of a row are contiguous.
      for (int row = 0; row < kTileRows; ++row) {
        const uint32_t covered = tile->covered[size_t(row)];
        if (mask[size_t(row)] != 0) {
          const uint64_t before = rank + uint64_t(std::popcount(covered & ((1u << (bx % 4 * 8)) - 1)));
          const auto count = uint64_t(std::popcount(mask[size_t(row)]));
          std::memcpy(out_.targets[t].data() + n * kept, values + before * kept, count * kept);
          n += count;
        }
        rank += uint64_t(std::popcount(covered));
      }
      return;
    }
    for (int row = 0; row < kTileRows; ++row) {
      const uint32_t covered = tile != nullptr ? tile->covered[size_t(row)] : CoveredWord(r, bx, row);
      for (uint32_t left = mask[size_t(row)]; left != 0; left &= left - 1, ++n) {
        const int bit = int(bx % 4) * 8 + std::countr_zero(left);
        const bool here = (covered >> bit & 1) != 0;
        const uint64_t index = rank + uint64_t(std::popcount(covered & ((1u << bit) - 1)));
        for (int c = 0; c < components; ++c) {
          const uint32_t stored = !here      ? Filled(target, c, r, bx, row, bit)
                                  : kept > 0 ? Kept(target, values + index * kept, c, r, bx, row, bit)
                                             : 1;
          const uint64_t at = planar ? uint64_t(c) * all_voxels + n : n * uint64_t(components) + uint64_t(c);
          PutElement(out_.targets[t].data(), bits, at, stored);
        }
      }
      rank += uint64_t(std::popcount(covered));
    }
  }

  // The value of a filled voxel without a fragment of the target.
  uint32_t Filled(const CpuTarget& target, int c, int64_t r, int64_t bx, int row, int bit) const {
    const int64_t y = r % ny_ * kBrick + row % 8, z = state_.slab.begin + r / ny_ * kBrick + row / 8;
    const int64_t x = bx / 4 * 32 + bit;
    return FillStored(state_.FillOf(target, SlabRowOf(r, row), x), x, y, z, c);
  }

  // A tile's value. If the fragments of this target were discarded and another target covers the voxel: the value that
  // a dense target holds.
  uint32_t Kept(const CpuTarget& target, const uint8_t* value, int c, int64_t r, int64_t bx, int row, int bit) const {
    if (target.own_presence) {
      const int64_t slab_row = SlabRowOf(r, row);
      const size_t w = size_t(bx / 4);
      if ((target.presence.row(slab_row)[w] >> bit & 1) == 0) {
        const bool inside = !state_.inside.empty() && (state_.inside.row(slab_row)[w] >> bit & 1) != 0;
        return inside ? Filled(target, c, r, bx, row, bit) : target.clear_stored;
      }
    }
    const int bytes = target.spec.format == VoxelFormat::kBit ? 1 : BitsPerComponent(target.spec.format) / 8;
    uint32_t stored = 0;
    std::memcpy(&stored, value + c * bytes, size_t(bytes));
    return stored;
  }

  int64_t SlabRowOf(int64_t r, int row) const {
    return (r % ny_ * kBrick + row % 8) + state_.dims[1] * (r / ny_ * kBrick + row / 8);
  }

  uint32_t CoveredWord(int64_t r, int64_t bx, int row) const {
    if (r % ny_ * kBrick + row % 8 >= state_.dims[1] || r / ny_ * kBrick + row / 8 >= state_.slab_dims[2]) return 0;
    return state_.coverage.row(SlabRowOf(r, row))[size_t(bx / 4)];
  }

  const TileValues* Tile(int64_t r, int64_t bx) const {
    if (state_.tile_values.empty()) return nullptr;
    const uint64_t local = uint64_t(bx / 4 + state_.tiles.dims[0] * r);  // tiles are as deep and as high as bricks
    const uint32_t number = state_.slab_tiles[local];
    return number == UINT32_MAX ? nullptr : &state_.tile_values[number];
  }

  const RunState& state_;
  const int64_t nx_, ny_, nz_;  // bricks of the slab
  std::vector<BrickRow> rows_;
  ResultArrays out_;
};

}  // namespace

uint8_t* ValueArena::Take(uint64_t bytes) {
  if (chunks_.empty() || chunks_.back().size() - used_ < bytes) {
    // Chunks grow with their number, so that little is left over; those from the pool have at least 2 MB.
    uint64_t size = std::clamp(total_ / 4, kMinChunkBytes, kMaxChunkBytes);
    if (size >= kPooledBytes) size = std::max(kPooledUnit, size);
    absl::StatusOr<HostBuffer> chunk = HostBuffer::Allocate(std::max(bytes, size));
    if (!chunk.ok()) throw std::bad_alloc();
    total_ += chunk->size();
    chunks_.push_back(*std::move(chunk));
    used_ = 0;
  }
  uint8_t* const taken = chunks_.back().data() + used_;
  used_ += bytes;
  return taken;
}

namespace {

// Writes the voxels of `covered` one after the other; component c is in stored[c]. Out: the end of the written bytes.
template <typename Element>
uint8_t* ListRow(uint32_t covered, int components, const uint32_t (&stored)[4][32], uint8_t* out) {
  for (uint32_t left = covered; left != 0; left &= left - 1) {
    const int bit = std::countr_zero(left);
    for (int c = 0; c < components; ++c, out += sizeof(Element)) {
      const auto element = Element(stored[c][bit]);
      std::memcpy(out, &element, sizeof element);
    }
  }
  return out;
}

}  // namespace

uint64_t KeptTileBytes(const RunState& state, const std::array<uint32_t, kTileRows>& covered) {
  uint64_t listed = 0, bytes = 0;
  for (const uint32_t word : covered) listed += uint64_t(std::popcount(word));
  for (const CpuTarget& target : state.targets) bytes += listed * KeptBytes(target);
  return bytes;
}

TileValues KeepTile(const RunState& state, const std::vector<TileBuffer>& buffers,
                    const std::array<uint32_t, kTileRows>& covered, ValueArena& arena) {
  TileValues values;
  values.covered = covered;
  uint8_t* out = arena.Take(KeptTileBytes(state, covered));
  values.data = out;
  for (size_t t = 0; t < state.targets.size(); ++t) {
    const CpuTarget& target = state.targets[t];
    if (target.is_occupancy) continue;
    const int components = target.spec.components;
    const size_t element =
        target.spec.format == VoxelFormat::kBit ? 1 : size_t(BitsPerComponent(target.spec.format) / 8);
    for (int row = 0; row < kTileRows; ++row) {
      if (covered[size_t(row)] == 0) continue;
      // Not read where only another target has a fragment.
      const uint32_t has = covered[size_t(row)] & buffers[t].presence(row);
      uint32_t stored[4][32];
      if (has != covered[size_t(row)]) std::memset(stored, 0, sizeof stored);
      for (int c = 0; c < components; ++c) buffers[t].StoredRow(row, c, has, stored[c]);
      switch (element) {
        case 1: out = ListRow<uint8_t>(covered[size_t(row)], components, stored, out); break;
        case 2: out = ListRow<uint16_t>(covered[size_t(row)], components, stored, out); break;
        default: out = ListRow<uint32_t>(covered[size_t(row)], components, stored, out); break;
      }
    }
  }
  return values;
}

absl::StatusOr<ResultArrays> MakeBricks(const RunState& state) {
  return BrickMaker(state).Make();
}

}  // namespace voxelpipe::cpu
