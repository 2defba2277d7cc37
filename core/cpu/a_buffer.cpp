#include "cpu/a_buffer.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <span>

#include "base/parallel.h"
#include "cpu/base/element_store.h"
#include "cpu/tile_runs.h"
#include "pipeline/plan/list_memory.h"
#include "raster/spans.h"
#include "shaders/blend_ops.h"
#include "shaders/interface/fragment_input.h"

namespace voxelpipe::cpu {
namespace {

// The traits of all targets' shaders together.
ShaderTraits AllTraits(const RunState& state) {
  ShaderTraits traits;
  for (const CpuTarget& target : state.targets) traits |= TraitsOf(target.shader);
  return traits;
}

bool EveryTargetCanDiscard(const RunState& state) {
  return std::all_of(state.targets.begin(), state.targets.end(), [](const CpuTarget& t) { return t.own_presence; });
}

// Shades the fragments of one triangle, voxel after voxel.
class TriangleShader {
 public:
  TriangleShader(const RunState& state, const ShaderTraits& traits, uint32_t triangle) : traits_(traits) {
    const uint32_t* v = state.view.triangles[triangle];
    plane_ = SetUpPlane(state.index_positions[v[0]], state.index_positions[v[1]], state.index_positions[v[2]]);
    in_ = MakeFragmentInput(state.view, triangle, plane_.degenerate, traits.reads_textures());
  }

  void MoveTo(int64_t x, int64_t y, int64_t z) {
    in_.voxel[0] = x;
    in_.voxel[1] = y;
    in_.voxel[2] = z;
    if (traits_.needs_barycentrics) in_.barycentric = Barycentrics(plane_, x, y, z);
  }

  FragmentOutput Shade(const CpuTarget& target) const {
    FragmentOutput out;
    ShadeFragment(target.shader, in_, target.params, out);
    return out;
  }

 private:
  const ShaderTraits& traits_;
  TrianglePlane plane_;
  FragmentInput in_;
};

// The voxels of `mask` whose fragment at least one target keeps.
uint32_t NotDiscarded(const RunState& state, TriangleShader& shader, const VoxelRange& range, uint32_t row,
                      uint32_t mask) {
  uint32_t kept = 0;
  for (uint32_t left = mask; left != 0; left &= left - 1) {
    const int bit = std::countr_zero(left);
    shader.MoveTo(range.begin[0] + bit, range.begin[1] + row % 8, range.begin[2] + row / 8);
    const bool any = std::any_of(state.targets.begin(), state.targets.end(),
                                 [&](const CpuTarget& target) { return !shader.Shade(target).discard; });
    if (any) kept |= 1u << bit;
  }
  return kept;
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

void EmitTile(const RunState& state, const TileRun& run, const ShaderTraits& traits, bool may_drop,
              RecordWriter& records, TileFragments& tile) {
  const VoxelRange range = TileVoxels(state.tiles, state.pairs[run.begin] >> 32, state.dims);
  for (uint64_t i = run.begin; i < run.end && records.MayGoOn() && MayGoOn(state, i - run.begin); ++i) {
    const uint32_t triangle = uint32_t(state.pairs[i]);
    const uint32_t* v = state.view.triangles[triangle];
    const TriangleSetup setup = SetUpTriangle(state.index_positions[v[0]], state.index_positions[v[1]],
                                              state.index_positions[v[2]], state.request.request.coverage);
    std::optional<TriangleShader> shader;
    ForEachRowSpan(setup, range, [&](int64_t y, int64_t z, int64_t x_begin, int64_t x_end) {
      const auto row = uint32_t((y - range.begin[1]) + 8 * (z - range.begin[2]));
      uint32_t mask = RowMask(x_begin - range.begin[0], x_end - range.begin[0]);
      if (may_drop) {
        if (!shader) shader.emplace(state, traits, triangle);
        mask = NotDiscarded(state, *shader, range, row, mask);
        if (mask == 0) return;
      }
      records.Add({triangle, mask, row}, tile);
      tile.row_voxels[row] |= mask;
      tile.row_fragments[row] += uint64_t(std::popcount(mask));
    });
  }
  records.Flush(tile);
}

// Writes a tile's voxels, offsets, triangles and shaded fragments.
class TileResolver {
 public:
  TileResolver(const RunState& state, const ShaderTraits& traits, ABuffer& out)
      : state_(state), traits_(traits), out_(out) {
    shades_ = std::any_of(state.targets.begin(), state.targets.end(),
                          [](const CpuTarget& t) { return t.shader != FragmentShaderId::kOccupancy; });
  }

  void Resolve(const TileFragments& tile, const VoxelRange& range) {
    ListVoxels(tile, range);
    std::optional<TriangleShader> shader;
    uint32_t shaded = UINT32_MAX;
    uint64_t r = 0;
    for (const std::span<const RowFragments> records : tile.records)
      for (const RowFragments& record : records) {
        if (!MayGoOn(state_, r++)) return;
        if (shades_ && (!shader || record.triangle != shaded)) {
          shader.emplace(state_, traits_, record.triangle);
          shaded = record.triangle;
        }
        for (uint32_t left = record.mask; left != 0; left &= left - 1) {
          const int bit = std::countr_zero(left);
          const uint64_t at = next_[record.row * 32 + uint32_t(bit)]++;
          PutElement(out_.arrays.triangles.data(), 32, at, record.triangle);
          if (shader)
            shader->MoveTo(range.begin[0] + bit, range.begin[1] + record.row % 8, range.begin[2] + record.row / 8);
          for (size_t t = 0; t < state_.targets.size(); ++t) PutOutput(t, shader, at);
        }
      }
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

  void PutOutput(size_t t, const std::optional<TriangleShader>& shader, uint64_t at) {
    const CpuTarget& target = state_.targets[t];
    const VoxelFormat format = target.spec.format;
    const int components = target.spec.components, bits = BitsPerComponent(format);
    FragmentOutput out;
    if (shader) {
      out = shader->Shade(target);
    } else {
      out.f[0] = 1;  // occupancy
    }
    for (int c = 0; c < components; ++c) {
      uint32_t stored = target.clear_stored;
      if (!out.discard && format == VoxelFormat::kBit) {
        stored = ToBit(out, target.u32_output);
      } else if (!out.discard) {
        stored = StoredBits(ToCell(out, target.u32_output, c, target.kept_format, target.scale), target.kept_format);
      }
      const bool planar = state_.request.request.layout == Layout::kPlanar;
      const uint64_t element = planar ? uint64_t(c) * out_.fragments + at : at * uint64_t(components) + uint64_t(c);
      PutElement(out_.arrays.targets[t].data(), bits, element, stored);
    }
  }

  const RunState& state_;
  const ShaderTraits& traits_;
  ABuffer& out_;
  bool shades_ = false;
  std::array<uint64_t, kTileVoxels> next_{};
};

}  // namespace

absl::Status EmitFragments(RunState& state) {
  const std::span<const TileRun> runs = SlabRuns(state);
  state.a_buffer = std::make_shared<ABuffer>();
  ABuffer& out = *state.a_buffer;
  out.tiles.resize(runs.size());
  const ShaderTraits traits = AllTraits(state);
  const bool may_drop = EveryTargetCanDiscard(state);
  ListCount count(state.lists, runs.size() * sizeof(TileFragments));
  tbb::enumerable_thread_specific<RecordWriter> writers([&] { return RecordWriter(out.arenas.local(), count); });
  const absl::Status s = ParallelChunks(int64_t(runs.size()), 1, state.job, [&](int64_t begin, int64_t end) {
    RecordWriter& records = writers.local();
    for (int64_t i = begin; i < end && !count.stopped(); ++i) {
      EmitTile(state, runs[size_t(i)], traits, may_drop, records, out.tiles[size_t(i)]);
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
  const ShaderTraits traits = AllTraits(state);
  tbb::enumerable_thread_specific<TileResolver> resolvers([&] { return TileResolver(state, traits, out); });
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
