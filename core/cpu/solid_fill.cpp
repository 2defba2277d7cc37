// Parity fill: each crossing toggles a bit, then a suffix XOR along each row. Nonzero fill: each crossing adds its
// sign, then suffix sums.
//
// Source: the fill of M. Schwarz and H.-P. Seidel, "Fast Parallel Surface and Solid Voxelization on GPUs", 2010,
// section 5. Changed: crossings are counted per edge (raster/crossing.h), so that closed meshes leave no streaks; a
// single bit is toggled and spread at the end. Crossings are binned to blocks of rows; one thread works on a block,
// which stays in its cache.
#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <atomic>
#include <bit>
#include <cstring>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "cpu/base/task_sizes.h"
#include "cpu/dense_fill.h"
#include "cpu/flood_fill.h"
#include "cpu/part_fill.h"
#include "cpu/rows/crossings.h"
#include "cpu/rows/row_bins.h"
#include "cpu/run_state.h"
#include "pipeline/stages/target_rules.h"

namespace voxelpipe::cpu {
namespace {

constexpr int64_t kBlockBytes = 256 << 10;  // of toggles: stay in the L2 cache beside their output

LineBlocks BlocksOf(const RunState& state) {
  const bool signs = state.request.request.fill == Fill::kNonzero;
  LineBlocks lines{state.dims[0], state.dims[1], state.slab.begin, state.slab.end, (state.dims[0] + 31) / 32 * 32, 0,
                   signs};
  const int64_t bytes = signs ? kSumBlockBytes : kBlockBytes;
  const auto wanted = std::max(bytes / (lines.row_bits / 8), lines.rows() / kMaxLineBlocks);
  lines.block_shift = std::bit_width(uint64_t(std::max<int64_t>(1, wanted))) - 1;
  return lines;
}

// The lists of one thread.
struct ThreadWork {
  ThreadWork(size_t blocks, size_t kinds) : toggles(kinds * blocks), large(blocks) {}
  Crossings found;
  Bins<uint32_t> toggles;  // bits of a block, kind by kind
  Bins<uint32_t> large;    // triangle ids
};

using WorkOfThreads = tbb::enumerable_thread_specific<ThreadWork>;

// Finds the crossings of triangles [begin, end), except those of large triangles.
void GatherCrossings(const RowKernels& kernels, const RowMesh& mesh, int64_t begin, int64_t end,
                     const LineBlocks& lines, ThreadWork& work) {
  Crossings& found = work.found;
  for (int64_t first = begin; first < end; first += Crossings::kMaxTriangles) {
    found.Clear();
    kernels.cross_small(mesh, first, std::min(end, first + Crossings::kMaxTriangles), lines, found);
    for (int64_t i = 0; i < found.count; ++i) {
      work.toggles.Push(size_t(found.crossing[i] >> 32), uint32_t(found.crossing[i]));
    }
    for (int64_t i = 0; i < found.larges; ++i) {
      const uint32_t* v = mesh.triangles[found.large[i]];
      const LineRange range = LinesOf(mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]], lines);
      const int64_t first_row = range.y_begin + lines.ny * (range.z_begin - lines.z_begin);
      const int64_t last_row = range.y_end - 1 + lines.ny * (range.z_end - 1 - lines.z_begin);
      for (int64_t block = first_row >> lines.block_shift; block <= last_row >> lines.block_shift; ++block) {
        work.large.Push(size_t(block), found.large[i]);
      }
    }
  }
}

// Sums of one block, all 0 between blocks.
struct BlockSums {
  explicit BlockSums(uint64_t words, uint64_t rows) : touched(words), sums(words * 32), outside(rows) {}
  std::vector<uint32_t> touched, sums, outside;
};

// Sets bit i of each row if the row's sums at i and beyond do not sum to 0; with `add` it is or-ed to the bits in
// `out`. Sets the sums to 0. Returns the number of rows whose signs do not sum to 0.
int64_t SpreadSums(BlockSums& in, int64_t rows, int64_t words_per_row, uint32_t* out, bool add) {
  int64_t odd = 0;
  for (int64_t r = 0; r < rows; ++r) {
    uint32_t sum = 0;
    for (int64_t w = (r + 1) * words_per_row; w-- > r * words_per_row;) {
      uint32_t inside = sum != 0 ? ~0u : 0;
      for (uint32_t left = std::exchange(in.touched[size_t(w)], 0); left != 0;) {
        const int bit = 31 - std::countl_zero(left);
        left &= ~(1u << bit);
        sum += std::exchange(in.sums[size_t(w * 32 + bit)], 0);
        const uint32_t upto = ~0u >> (31 - bit);
        inside = sum != 0 ? inside | upto : inside & ~upto;
      }
      out[w] = add ? out[w] | inside : inside;
    }
    odd += sum + std::exchange(in.outside[size_t(r)], 0) != 0;
  }
  return odd;
}

// True if crossings or large triangles were binned to a block.
bool IsCrossed(const WorkOfThreads& work, const LineBlocks& lines, int64_t block) {
  bool crossed = false;
  const auto see = [&](const uint32_t*, int64_t n) { crossed = crossed || n > 0; };
  const auto kinds = size_t(lines.kinds());
  for (const ThreadWork& thread : work) {
    for (size_t kind = 0; kind < kinds; ++kind) thread.toggles.ForEachBlock(kinds * size_t(block) + kind, see);
    thread.large.ForEachBlock(size_t(block), see);
  }
  return crossed;
}

// The filled voxels by the signs of crossings; parameters as in Cast.
absl::Status SumBlocks(RunState& state, const LineBlocks& lines, const RowMesh& mesh, WorkOfThreads& work, BitGrid& out,
                       bool add) {
  const RowKernels& kernels = *state.kernels;
  const int64_t block_rows = std::min(lines.rows(), int64_t{1} << lines.block_shift);
  const int64_t words_per_row = lines.row_bits / 32;
  tbb::enumerable_thread_specific<BlockSums> scratch(
      [&] { return BlockSums(uint64_t(block_rows * words_per_row), uint64_t(block_rows)); });
  std::atomic<int64_t> odd{0};
  absl::Status s = ParallelChunks(lines.blocks(), 1, state.job, [&](int64_t begin, int64_t end) {
    BlockSums& memory = scratch.local();
    const BlockToggles sums{memory.touched.data(), nullptr, memory.sums.data(), memory.outside.data()};
    for (int64_t block = begin; block < end; ++block) {
      const int64_t first = block << lines.block_shift, rows = std::min(block_rows, lines.rows() - first);
      uint32_t* const to = out.row(first).data();
      if (!IsCrossed(work, lines, block)) {
        if (!add) std::fill_n(to, rows * words_per_row, 0u);
        continue;
      }
      for (const ThreadWork& thread : work) {  // sums commute: the order of threads does not matter
        for (const size_t kind : {0, 1, 2, 3}) {
          const uint32_t sign = kind < 2 ? kRises : kFalls;
          thread.toggles.ForEachBlock(size_t(4 * block) + kind, [&](const uint32_t* bits, int64_t n) {
            for (int64_t i = 0; i < n; ++i) {
              kind % 2 == 0 ? sums.Sum(bits[i], sign) : void(sums.outside_sums[bits[i]] += sign);
            }
          });
        }
        thread.large.ForEachBlock(size_t(block), [&](const uint32_t* ids, int64_t n) {
          for (int64_t i = 0; i < n; ++i) kernels.cross_large(mesh, ids[i], lines, block, sums);
        });
      }
      odd += SpreadSums(memory, rows, words_per_row, to, add);
    }
  });
  state.counts.odd_columns = uint64_t(odd.load());
  return s;
}

// The filled voxels by the parity of crossings; parameters as in Cast.
absl::Status ToggleBlocks(RunState& state, const LineBlocks& lines, const RowMesh& mesh, WorkOfThreads& work,
                          BitGrid& out, bool add) {
  const RowKernels& kernels = *state.kernels;
  const int64_t block_rows = std::min(lines.rows(), int64_t{1} << lines.block_shift);
  const int64_t words_per_row = lines.row_bits / 32, words = block_rows * words_per_row;
  tbb::enumerable_thread_specific<HostArray<uint32_t>> scratch(
      [&] { return HostArray<uint32_t>(uint64_t(words + (block_rows + 31) / 32)); });
  std::atomic<int64_t> odd{0};
  absl::Status s = ParallelChunks(lines.blocks(), 1, state.job, [&](int64_t begin, int64_t end) {
    HostArray<uint32_t>& memory = scratch.local();
    const BlockToggles toggles{memory.data(), memory.data() + words};
    for (int64_t block = begin; block < end; ++block) {
      const int64_t first = block << lines.block_shift, rows = std::min(block_rows, lines.rows() - first);
      uint32_t* const filled = out.row(first).data();
      if (!IsCrossed(work, lines, block)) {
        if (!add) std::fill_n(filled, rows * words_per_row, 0u);
        continue;
      }
      std::memset(memory.data(), 0, memory.size() * sizeof(uint32_t));
      for (const ThreadWork& thread : work) {  // toggling commutes: the order of threads does not matter
        for (const bool outside : {false, true}) {
          uint32_t* const to = outside ? toggles.outside : toggles.words;
          thread.toggles.ForEachBlock(size_t(2 * block + outside), [&](const uint32_t* bits, int64_t n) {
            for (int64_t i = 0; i < n; ++i) to[bits[i] / 32] ^= 1u << (bits[i] % 32);
          });
        }
        thread.large.ForEachBlock(size_t(block), [&](const uint32_t* ids, int64_t n) {
          for (int64_t i = 0; i < n; ++i) kernels.cross_large(mesh, ids[i], lines, block, toggles);
        });
      }
      odd += kernels.spread_toggles(toggles, rows, words_per_row, filled, add);
    }
  });
  state.counts.odd_columns = uint64_t(odd.load());
  return s;
}

// Writes the filled voxels, by the crossings of lines along x, to `out` over the slab's rows: replaces its bits, or
// adds to them.
absl::Status Cast(RunState& state, BitGrid& out, bool add) {
  const LineBlocks lines = BlocksOf(state);
  const RowMesh mesh = IndexSpaceMesh(state.index_positions, state.view.triangles);
  WorkOfThreads work([&] { return ThreadWork(size_t(lines.blocks()), size_t(lines.kinds())); });
  absl::Status s = ParallelChunks(
      int64_t(state.view.triangle_count), kTriangleGrain, state.job,
      [&](int64_t begin, int64_t end) { GatherCrossings(*state.kernels, mesh, begin, end, lines, work.local()); });
  if (!s.ok()) return s;
  return lines.with_signs ? SumBlocks(state, lines, mesh, work, out, add)
                          : ToggleBlocks(state, lines, mesh, work, out, add);
}

// True if the result treats filled and covered voxels alike, so that one grid holds both.
bool JoinsCoverage(const RunState& state) {
  return state.request.request.result == ResultKind::kDense &&
         std::all_of(state.targets.begin(), state.targets.end(), [](const CpuTarget& target) {
           return target.is_occupancy && target.spec.clear == 0 && FillBit(target.spec);
         });
}

absl::Status Inside(RunState& state, BitGrid& out, bool add) {
  if (state.by_parts) return FillParts(state, out, add);
  return state.request.request.fill == Fill::kFlood ? FloodInside(state, out, add) : Cast(state, out, add);
}

absl::Status MakeInside(RunState& state) {
  if (state.request.request.fill == Fill::kFlood) return FloodInside(state, state.inside, false);
  auto inside = BitGrid::CreateUncleared(state.slab_dims);
  if (!inside.ok()) return inside.status();
  state.inside = *std::move(inside);
  return Inside(state, state.inside, false);
}

}  // namespace

absl::Status FindOwners(RunState& state) {
  // Without coverage the inside is all there is; SolidFill makes it where it belongs.
  return state.row_bits && !state.needs_ranks ? absl::OkStatus() : MakeInside(state);
}

absl::Status SolidFill(RunState& state) {
  if (JoinsCoverage(state) && state.inside.empty()) return Inside(state, state.coverage, true);
  if (state.inside.empty()) {
    if (absl::Status s = MakeInside(state); !s.ok()) return s;
  }
  if (state.request.request.result == ResultKind::kSparse)
    return absl::OkStatus();  // the bricks are filled as they are made
  return ParallelChunks(state.inside.rows(), 256, state.job, [&](int64_t begin, int64_t end) {
    for (int64_t r = begin; r < end; ++r) {
      for (CpuTarget& target : state.targets) {
        if (target.spec.format != VoxelFormat::kBit) FillRow(state, target, r, state.inside.row(r));
      }
    }
  });
}

}  // namespace voxelpipe::cpu
