#include "cpu/a_buffer.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <span>

#include "base/parallel.h"
#include "cpu/base/element_store.h"
#include "cpu/base/part_cursor.h"
#include "cpu/shading/batch_shader.h"
#include "cpu/tile_runs.h"
#include "pipeline/plan/list_memory.h"
#include "shaders/blend_ops.h"

namespace voxelpipe::cpu {
namespace {

using Shaders = std::vector<BuiltInShader>;  // of the targets

Shaders ShadersOf(const RunState& state) {
  Shaders shaders;
  for (const CpuTarget& target : state.targets) {
    shaders.emplace_back(*state.shade_kernels, target.shader, target.params);
  }
  return shaders;
}

bool NeedsPlane(const RunState& state) {
  return std::any_of(state.targets.begin(), state.targets.end(),
                     [](const CpuTarget& t) { return TraitsOf(t.shader).needs_plane; });
}

void SetOrigin(FragmentBatch& batch, const VoxelRange& tile) {
  for (int a = 0; a < 3; ++a) batch.origin[a] = int32_t(tile.begin[a]);
}

// A tile may hold every triangle of the mesh, so the job is checked within tiles too. An incomplete tile is discarded.
constexpr uint64_t kItemsBetweenChecks = 512;

bool MayGoOn(const RunState& state, uint64_t item) {
  return item % kItemsBetweenChecks != 0 || state.job.Check().ok();
}

// Buffers a thread's records before they are copied to its arena.
class RecordWriter {
 public:
  RecordWriter(ValueArena& arena, ListCount& count) : arena_(arena), count_(count) {}

  bool MayGoOn() const { return !count_.stopped(); }
  void Add(const RowFragments& record, TileFragments& tile) {
    if (records_.size() == kMaxRecords) Flush(tile);
    records_.push_back(record);
  }
  // The tile's last.
  void Flush(TileFragments& tile) {
    const uint64_t bytes = records_.size() * sizeof(RowFragments);
    if (bytes > 0 && count_.Add(bytes)) {
      uint8_t* const kept = arena_.Take(bytes);
      std::memcpy(kept, records_.data(), bytes);
      tile.records.emplace_back(reinterpret_cast<const RowFragments*>(kept), records_.size());
    }
    records_.clear();
  }

 private:
  static constexpr size_t kMaxRecords = 4096;

  ValueArena& arena_;
  ListCount& count_;
  std::vector<RowFragments> records_;
};

// Makes the records of tiles. Drops the fragments that the shaders of all targets discard.
class Emitter {
 public:
  Emitter(const RunState& state, ValueArena& arena, ListCount& count)
      : state_(state), records_(arena, count), part_(state.view), shaders_(ShadersOf(state)) {
    batch_.mesh = &state.view;
  }

  void Emit(const TileRun& run, TileFragments& tile) {
    const VoxelRange range = TileVoxels(state_.tiles, state_.pairs[run.begin] >> 32, state_.dims);
    SetOrigin(batch_, range);
    tile_ = &tile;
    ForEachTriangle(state_, run, range, TileOrder::kForward, spans_,
                    [&](uint32_t triangle, std::span<const TileSpan> spans) {
                      if (!part_.IsIn(triangle)) EnterPartOf(triangle);
                      for (const TileSpan span : spans) {
                        const RowFragments record{triangle, span.mask(), uint32_t(span.row())};
                        may_drop_ ? Shade(record) : Add(record);
                      }
                      return records_.MayGoOn();
                    });
    Flush();
    records_.Flush(tile);
  }

 private:
  void EnterPartOf(uint32_t triangle) {
    Flush();
    part_.MoveTo(triangle);
    batch_.part = &part_.part();
    const MaterialView& material = state_.view.materials[part_.part().material];
    may_drop_ = std::all_of(state_.targets.begin(), state_.targets.end(),
                            [&](const CpuTarget& t) { return MayDiscard(t.shader, material); });
  }

  void Add(const RowFragments& record) {
    if (record.mask == 0) return;
    records_.Add(record, *tile_);
    tile_->row_voxels[record.row] |= record.mask;
    tile_->row_fragments[record.row] += uint64_t(std::popcount(record.mask));
  }

  // Adds the record once it is known which of its fragments are kept.
  void Shade(const RowFragments& record) {
    uncertain_.push_back({record.triangle, 0, record.row});
    for (uint32_t left = record.mask; left != 0; left &= left - 1) {
      if (batch_.full()) {
        Flush();
        uncertain_.push_back({record.triangle, 0, record.row});
      }
      if (batch_.count == 0 || batch_.triangle[batch_.triangles - 1] != record.triangle) {
        batch_.AddTriangle(record.triangle);
      }
      record_of_[batch_.count] = uint32_t(uncertain_.size() - 1);
      batch_.AddFragment(record.row * 32 + size_t(std::countr_zero(left)));
    }
  }

  void Flush() {
    if (batch_.count > 0) {
      batch_.Complete();
      state_.shade_kernels->place(batch_);
      for (const BuiltInShader& shader : shaders_) {
        shader.Shade(batch_, shaded_);
        for (int i = 0; i < batch_.count; ++i) {
          uncertain_[record_of_[i]].mask |= uint32_t(shaded_.discard[i] == 0) << (batch_.place[i] % 32);
        }
      }
      for (const RowFragments& record : uncertain_) Add(record);
    }
    uncertain_.clear();
    batch_.Clear();
  }

  const RunState& state_;
  RecordWriter records_;
  TileFragments* tile_ = nullptr;
  TileSpans spans_;
  PartCursor part_;
  bool may_drop_ = false;  // all targets' shaders may discard fragments of the part
  const Shaders shaders_;
  FragmentBatch batch_;
  ShadedBatch shaded_;
  std::vector<RowFragments> uncertain_;  // the records of the batch, with the fragments that are kept
  uint32_t record_of_[kBatchFragments];  // of each fragment
};

// Writes a tile's voxels, offsets, triangles and shaded fragments.
class TileResolver {
 public:
  TileResolver(const RunState& state, ABuffer& out)
      : state_(state), out_(out), part_(state.view), shaders_(ShadersOf(state)), needs_plane_(NeedsPlane(state)) {
    shades_ = std::any_of(state.targets.begin(), state.targets.end(),
                          [](const CpuTarget& t) { return t.shader != FragmentShaderId::kOccupancy; });
    batch_.mesh = &state.view;
  }

  void Resolve(const TileFragments& tile, const VoxelRange& range) {
    ListVoxels(tile, range);
    SetOrigin(batch_, range);
    uint64_t r = 0;
    for (const std::span<const RowFragments> records : tile.records) {
      for (const RowFragments& record : records) {
        if (!MayGoOn(state_, r++)) return batch_.Clear();
        if (shades_ && !part_.IsIn(record.triangle)) {
          Flush();
          part_.MoveTo(record.triangle);
          batch_.part = &part_.part();
        }
        for (uint32_t left = record.mask; left != 0; left &= left - 1) {
          const int bit = std::countr_zero(left);
          const uint64_t at = next_[record.row * 32 + uint32_t(bit)]++;
          PutElement(out_.arrays.triangles.data(), 32, at, record.triangle);
          if (!shades_) {
            PutOnes(at);
            continue;
          }
          if (batch_.full()) Flush();
          if (batch_.count == 0 || batch_.triangle[batch_.triangles - 1] != record.triangle) {
            batch_.AddTriangle(record.triangle);
          }
          at_[batch_.count] = at;
          batch_.AddFragment(record.row * 32 + size_t(bit));
        }
      }
    }
    Flush();
  }

 private:
  // Counts the fragments of each voxel; next_ becomes the index of each voxel's first.
  void ListVoxels(const TileFragments& tile, const VoxelRange& range) {
    next_.fill(0);
    for (const std::span<const RowFragments> records : tile.records) {
      for (const RowFragments& record : records) {
        for (uint32_t left = record.mask; left != 0; left &= left - 1) {
          ++next_[record.row * 32 + uint32_t(std::countr_zero(left))];
        }
      }
    }
    for (uint32_t row = 0; row < kTileRows; ++row) {
      if (tile.row_voxels[row] == 0) continue;
      const int64_t y = range.begin[1] + row % 8, z = range.begin[2] + row / 8;
      const uint64_t first =
          uint64_t(range.begin[0]) + uint64_t(state_.dims[0]) * (uint64_t(y) + uint64_t(state_.dims[1]) * uint64_t(z));
      uint64_t fragment = tile.row_fragments[row], voxel = tile.row_first_voxel[row];
      for (uint32_t left = tile.row_voxels[row]; left != 0; left &= left - 1, ++voxel) {
        const auto bit = uint32_t(std::countr_zero(left));
        const uint64_t id = first + bit;
        std::memcpy(out_.arrays.voxels.data() + voxel * sizeof id, &id, sizeof id);
        std::memcpy(out_.arrays.offsets.data() + voxel * sizeof fragment, &fragment, sizeof fragment);
        const uint64_t count = next_[row * 32 + bit];
        next_[row * 32 + bit] = fragment;
        fragment += count;
      }
    }
  }

  // Where component c of a fragment is in its target's array.
  uint64_t ElementOf(int components, int c, uint64_t fragment) const {
    const bool planar = state_.request.request.layout == Layout::kPlanar;
    return planar ? uint64_t(c) * out_.fragments + fragment : fragment * uint64_t(components) + uint64_t(c);
  }

  // The targets' values of occupancy.
  void PutOnes(uint64_t at) {
    FragmentOutput one;
    one.f[0] = 1;
    for (size_t t = 0; t < state_.targets.size(); ++t) {
      const CpuTarget& target = state_.targets[t];
      const VoxelFormat format = target.spec.format;
      for (int c = 0; c < target.spec.components; ++c) {
        const uint32_t stored =
            format == VoxelFormat::kBit
                ? ToBit(one, target.u32_output)
                : StoredBits(ToCell(one, target.u32_output, c, target.kept_format, target.scale), target.kept_format);
        PutElement(out_.arrays.targets[t].data(), BitsPerComponent(format), ElementOf(target.spec.components, c, at),
                   stored);
      }
    }
  }

  // Shades the fragments of the batch, and writes what the targets keep of them.
  void Flush() {
    if (batch_.count > 0) {
      batch_.Complete();
      if (needs_plane_) state_.shade_kernels->place(batch_);
      for (size_t t = 0; t < state_.targets.size(); ++t) {
        shaders_[t].Shade(batch_, shaded_);
        switch (BitsPerComponent(state_.targets[t].spec.format)) {
          case 1: PutBits(t); break;
          case 8: PutCells<uint8_t>(t); break;
          case 16: PutCells<uint16_t>(t); break;
          default: PutCells<uint32_t>(t); break;
        }
      }
    }
    batch_.Clear();
  }

  void PutBits(size_t t) {
    const CpuTarget& target = state_.targets[t];
    for (int i = 0; i < batch_.count; ++i) {
      const bool bit = ToBit(OutputOf(shaded_, target.u32_output, i), target.u32_output);
      const uint32_t stored = shaded_.discard[i] != 0 ? target.clear_stored : bit;
      PutElement(out_.arrays.targets[t].data(), 1, at_[i], stored);
    }
  }

  template <typename Element>
  void PutCells(size_t t) {
    const CpuTarget& target = state_.targets[t];
    const int components = target.spec.components;
    BatchCells cells;
    state_.shade_kernels->to_cells(shaded_, batch_.count,
                                   {target.kept_format, target.u32_output, components, target.scale}, cells);
    uint8_t* const out = out_.arrays.targets[t].data();
    for (int i = 0; i < batch_.count; ++i) {
      for (int c = 0; c < components; ++c) {
        const bool discarded = shaded_.discard[i] != 0;
        const auto stored = Element(discarded ? target.clear_stored : StoredBits(cells[c][i], target.kept_format));
        std::memcpy(out + ElementOf(components, c, at_[i]) * sizeof stored, &stored, sizeof stored);
      }
    }
  }

  const RunState& state_;
  ABuffer& out_;
  PartCursor part_;
  const Shaders shaders_;
  const bool needs_plane_;
  bool shades_ = false;  // some shader is not occupancy
  FragmentBatch batch_;
  ShadedBatch shaded_;
  uint64_t at_[kBatchFragments];  // indices of the batch's fragments in the slab
  std::array<uint64_t, kTileVoxels> next_{};
};

}  // namespace

absl::Status EmitFragments(RunState& state) {
  const std::span<const TileRun> runs = SlabRuns(state);
  state.a_buffer = std::make_shared<ABuffer>();
  ABuffer& out = *state.a_buffer;
  out.tiles.resize(runs.size());
  ListCount count(state.lists, runs.size() * sizeof(TileFragments));
  tbb::enumerable_thread_specific<Emitter> emitters([&] { return Emitter(state, out.arenas.local(), count); });
  const absl::Status s = ParallelChunks(int64_t(runs.size()), 1, state.job, [&](int64_t begin, int64_t end) {
    Emitter& emitter = emitters.local();
    for (int64_t i = begin; i < end && !count.stopped(); ++i) {
      emitter.Emit(runs[size_t(i)], out.tiles[size_t(i)]);
    }
  });
  out.list_bytes = count.bytes();
  if (absl::Status full = count.status(); !full.ok()) return full;
  return s.ok() ? state.job.Check() : s;
}

absl::Status SortFragments(RunState& state) {
  ABuffer& out = *state.a_buffer;
  const std::span<const TileRun> runs = SlabRuns(state);
  const auto row_of = [&](size_t i) { return (state.pairs[runs[i].begin] >> 32) / uint64_t(state.tiles.dims[0]); };
  // Tiles of one row along x follow each other, rows of one layer too; voxels are ordered by z, then y, then x.
  for (size_t begin = 0; begin < runs.size();) {
    const uint64_t layer = row_of(begin) / uint64_t(state.tiles.dims[1]);
    size_t end = begin;
    while (end < runs.size() && row_of(end) / uint64_t(state.tiles.dims[1]) == layer) ++end;
    for (size_t z = 0; z < 8; ++z) {
      for (size_t first = begin; first < end;) {
        size_t last = first;
        while (last < end && row_of(last) == row_of(first)) ++last;
        for (size_t row = z * 8; row < z * 8 + 8; ++row) {
          for (size_t i = first; i < last; ++i) {
            TileFragments& tile = out.tiles[i];
            const uint64_t here = tile.row_fragments[row];
            tile.row_fragments[row] = out.fragments;
            tile.row_first_voxel[row] = out.voxels;
            out.fragments += here;
            out.voxels += uint64_t(std::popcount(tile.row_voxels[row]));
          }
        }
        first = last;
      }
    }
    begin = end;
  }
  state.counts.fragments = out.fragments;
  return state.job.Check();
}

absl::Status Resolve(RunState& state) {
  ABuffer& out = *state.a_buffer;
  const ResultHeader header = MakeResultHeader(state.request.request, state.grid, 0, out.voxels, out.fragments);
  if (state.lists != nullptr) {
    if (absl::Status full = state.lists->Need(out.list_bytes + BytesOf(header)); !full.ok()) return full;
  }
  absl::StatusOr<VoxelizeResult> arrays = AllocateResult(header);
  if (!arrays.ok()) return arrays.status();
  out.arrays = std::move(static_cast<ResultArrays&>(*arrays));
  for (size_t t = 0; t < state.targets.size(); ++t) {
    if (state.targets[t].spec.format == VoxelFormat::kBit) {
      std::fill_n(out.arrays.targets[t].data(), out.arrays.targets[t].size(), uint8_t{0});
    }
  }
  std::memcpy(out.arrays.offsets.data() + out.voxels * sizeof(uint64_t), &out.fragments, sizeof(uint64_t));
  const std::span<const TileRun> runs = SlabRuns(state);
  tbb::enumerable_thread_specific<TileResolver> resolvers([&] { return TileResolver(state, out); });
  const absl::Status s = ParallelChunks(int64_t(runs.size()), 1, state.job, [&](int64_t begin, int64_t end) {
    TileResolver& resolver = resolvers.local();
    for (int64_t i = begin; i < end; ++i) {
      const uint64_t tile = state.pairs[runs[size_t(i)].begin] >> 32;
      resolver.Resolve(out.tiles[size_t(i)], TileVoxels(state.tiles, tile, state.dims));
    }
  });
  return s.ok() ? state.job.Check() : s;
}

}  // namespace voxelpipe::cpu
