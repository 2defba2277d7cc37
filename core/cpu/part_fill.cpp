// Fill by parts: the crossings of each part with the lines along x decide about its inside alone (raster/crossing.h);
// of the parts around a voxel's centre the one of the highest rank owns it.
//
// Crossings are binned to blocks of rows, as for the other fills (solid_fill.cpp). One thread sorts those of a row by
// descending rank and x, and sweeps: each part paints what is inside and not yet painted, so that a voxel is written
// once, and words that are painted are passed over.
#include "cpu/part_fill.h"

#include <tbb/enumerable_thread_specific.h>

#include <algorithm>
#include <bit>
#include <vector>

#include "base/parallel.h"
#include "cpu/base/task_sizes.h"
#include "cpu/rows/crossings.h"
#include "cpu/rows/row_bins.h"

namespace voxelpipe::cpu {
namespace {

constexpr int64_t kBlockBytes = 64 << 10;  // of bits: with their ranks they stay in the L2 cache

// A crossing of one line by one part.
struct PartCrossing {
  uint32_t row;     // in its block
  uint32_t rank;    // of the part
  uint32_t before;  // voxels of the row whose centre lies before it
  int32_t sign;     // +1 rises, -1 falls
};

LineBlocks BlocksOf(const RunState& state) {
  LineBlocks lines{state.dims[0], state.dims[1], state.slab.begin, state.slab.end, (state.dims[0] + 31) / 32 * 32, 0,
                   true};
  const auto wanted = std::max(kBlockBytes / (lines.row_bits / 8), lines.rows() / kMaxLineBlocks);
  lines.block_shift = std::bit_width(uint64_t(std::max<int64_t>(1, wanted))) - 1;
  return lines;
}

// The lists of one thread.
struct ThreadWork {
  explicit ThreadWork(size_t blocks) : crossings(blocks) {}
  Crossings found;
  Bins<PartCrossing> crossings;  // by block
};
using WorkOfThreads = tbb::enumerable_thread_specific<ThreadWork>;

class Gatherer {
 public:
  Gatherer(const RunState& state, const LineBlocks& lines, const RowMesh& mesh, ListCount& count)
      : state_(state), lines_(lines), mesh_(mesh), count_(count) {}

  // Bins the crossings of triangles [begin, end). Runs of the view follow each other by rank.
  void Gather(int64_t begin, int64_t end, ThreadWork& work) {
    uint32_t run = PartOf(state_.view, uint64_t(begin));
    for (int64_t first = begin; first < end && !count_.stopped();) {
      const bool is_last = run + 1 == state_.view.part_count;
      const int64_t run_end = is_last ? end : int64_t(state_.view.parts[run + 1].first_triangle);
      if (run_end <= first) {
        ++run;
        continue;
      }
      const int64_t last = std::min({end, run_end, first + Crossings::kMaxTriangles});
      GatherRun(first, last, state_.view.parts[run].rank - 1, work);
      first = last;
    }
  }

 private:
  // Of triangles of one part.
  void GatherRun(int64_t first, int64_t last, uint32_t rank, ThreadWork& work) {
    Crossings& found = work.found;
    found.Clear();
    state_.kernels->cross_small(mesh_, first, last, lines_, found);
    for (int64_t i = 0; i < found.count; ++i) {
      const uint64_t bin = found.crossing[i] >> 32;
      const auto bit = uint32_t(found.crossing[i]);
      const bool outside = bin % 2 != 0;
      const auto row = outside ? bit : uint32_t(bit / uint64_t(lines_.row_bits));
      const auto before = outside ? 0 : uint32_t(bit % uint64_t(lines_.row_bits)) + 1;
      work.crossings.Push(size_t(bin / 4), {row, rank, before, bin % 4 < 2 ? 1 : -1});
    }
    uint64_t listed = uint64_t(found.count);
    for (int64_t i = 0; i < found.larges; ++i) listed += GatherLarge(found.large[i], rank, work);
    count_.Add(2 * listed * sizeof(PartCrossing));  // once more where they are sorted
  }

  uint64_t GatherLarge(uint32_t triangle, uint32_t rank, ThreadWork& work) {
    const uint32_t* const v = mesh_.triangles[triangle];
    const Vec3d &a = mesh_.positions[v[0]], &b = mesh_.positions[v[1]], &c = mesh_.positions[v[2]];
    const LineRange range = LinesOf(a, b, c, lines_);
    uint64_t listed = 0;
    for (int64_t z = range.z_begin; z < range.z_end; ++z) {
      if (!state_.job.Check().ok()) return listed;  // it may cross every line
      ForEachCrossing(a, b, c, {range.y_begin, range.y_end, z, z + 1}, lines_.nx,
                      [&](int64_t y, int64_t, int64_t before, bool falls) {
                        const int64_t row = y + lines_.ny * (z - lines_.z_begin), block = row >> lines_.block_shift;
                        const auto in_block = uint32_t(row - (block << lines_.block_shift));
                        work.crossings.Push(size_t(block), {in_block, rank, uint32_t(before), falls ? -1 : 1});
                        ++listed;
                      });
    }
    return listed;
  }

  const RunState& state_;
  const LineBlocks& lines_;
  const RowMesh& mesh_;
  ListCount& count_;
};

// Paints voxels [begin, end) of a row that are not painted yet. Returns how many.
int64_t Paint(uint32_t begin, uint32_t end, uint32_t rank, uint32_t* painted, uint16_t* ranks) {
  int64_t count = 0;
  for (uint32_t w = begin / 32; begin < end && w <= (end - 1) / 32; ++w) {
    uint32_t mask = ~painted[w];
    if (w == begin / 32) mask &= ~0u << (begin % 32);
    if (w == (end - 1) / 32) mask &= ~0u >> (31 - (end - 1) % 32);
    if (mask == 0) continue;
    painted[w] |= mask;
    count += std::popcount(mask);
    if (ranks == nullptr) continue;
    uint16_t* const to = ranks + w * 32;
    const auto value = uint16_t(rank + 1);
    if (mask == ~0u) {
      std::fill_n(to, 32, value);
      continue;
    }
    for (uint32_t left = mask; left != 0; left &= left - 1) to[std::countr_zero(left)] = value;
  }
  return count;
}

// What one thread counts of each part, by rank.
struct PartCounts {
  explicit PartCounts(size_t parts) : odd_columns(parts), voxels(parts) {}
  std::vector<uint64_t> odd_columns, voxels;
};

// Paints one row. In: its crossings by descending rank, then descending `before`. Counts what it paints, and the parts
// whose crossings are odd, or whose signs do not sum to 0.
void PaintRow(const PartCrossing* first, const PartCrossing* last, bool signs, uint32_t* painted, uint16_t* ranks,
              PartCounts& counts) {
  while (first != last) {
    const uint32_t rank = first->rank;
    int32_t sum = 0;
    while (first != last && first->rank == rank) {
      // All crossings at this place, then the voxels from the next place on.
      const uint32_t before = first->before;
      for (; first != last && first->rank == rank && first->before == before; ++first) sum += signs ? first->sign : 1;
      const bool inside = signs ? sum != 0 : sum % 2 != 0;
      const uint32_t next = first != last && first->rank == rank ? first->before : 0;
      if (inside) counts.voxels[rank] += uint64_t(Paint(next, before, rank, painted, ranks));
      if (next == 0 && (first == last || first->rank != rank)) counts.odd_columns[rank] += inside;
    }
  }
}

// The crossings of one block, sorted by row.
class BlockRows {
 public:
  void Collect(const WorkOfThreads& work, int64_t block, int64_t rows) {
    begin_.assign(size_t(rows) + 1, 0);
    ForEach(work, block, [&](const PartCrossing& c) { ++begin_[c.row + 1]; });
    for (size_t r = 1; r < begin_.size(); ++r) begin_[r] += begin_[r - 1];
    sorted_.resize(begin_.back());
    next_.assign(begin_.begin(), begin_.end());
    ForEach(work, block, [&](const PartCrossing& c) { sorted_[next_[c.row]++] = c; });
  }
  bool empty() const { return sorted_.empty(); }
  // By descending rank, then place.
  std::pair<const PartCrossing*, const PartCrossing*> Row(int64_t row) {
    PartCrossing* const first = sorted_.data() + begin_[size_t(row)];
    PartCrossing* const last = sorted_.data() + begin_[size_t(row) + 1];
    std::sort(first, last, [](const PartCrossing& a, const PartCrossing& b) {
      return a.rank != b.rank ? a.rank > b.rank : a.before > b.before;
    });
    return {first, last};
  }

 private:
  template <typename Visit>
  static void ForEach(const WorkOfThreads& work, int64_t block, const Visit& visit) {
    for (const ThreadWork& thread : work) {
      thread.crossings.ForEachBlock(size_t(block), [&](const PartCrossing* list, int64_t n) {
        for (int64_t i = 0; i < n; ++i) visit(list[i]);
      });
    }
  }

  std::vector<PartCrossing> sorted_;
  std::vector<uint64_t> begin_, next_;  // by row
};

}  // namespace

absl::Status FillParts(RunState& state, BitGrid& inside, bool add) {
  const LineBlocks lines = BlocksOf(state);
  const RowMesh mesh = IndexSpaceMesh(state.index_positions, state.view.triangles);
  if (state.needs_ranks) state.inside_ranks = HostArray<uint16_t>(state.slab_voxels());
  ListCount count(state.lists, 0);
  WorkOfThreads work([&] { return ThreadWork(size_t(lines.blocks())); });
  absl::Status s = ParallelChunks(
      int64_t(state.view.triangle_count), kTriangleGrain, state.job,
      [&](int64_t begin, int64_t end) { Gatherer(state, lines, mesh, count).Gather(begin, end, work.local()); });
  if (count.stopped()) return count.status();
  if (!s.ok()) return s;
  const bool signs = state.request.request.fill == Fill::kNonzero;
  const int64_t block_rows = std::min(lines.rows(), int64_t{1} << lines.block_shift);
  const int64_t words = lines.row_bits / 32;
  struct Scratch {
    explicit Scratch(size_t parts) : counts(parts) {}
    PartCounts counts;
    BlockRows rows;
    std::vector<uint32_t> painted;
    std::vector<uint16_t> ranks;
  };
  tbb::enumerable_thread_specific<Scratch> scratch([&] { return Scratch(state.part_count()); });
  s = ParallelChunks(lines.blocks(), 1, state.job, [&](int64_t begin, int64_t end) {
    Scratch& memory = scratch.local();
    memory.painted.resize(size_t(words));
    memory.ranks.resize(state.needs_ranks ? size_t(words) * 32 : 0);
    for (int64_t block = begin; block < end; ++block) {
      const int64_t first = block << lines.block_shift, rows = std::min(block_rows, lines.rows() - first);
      memory.rows.Collect(work, block, rows);
      for (int64_t r = 0; r < rows; ++r) {
        if (r % 256 == 255 && !state.job.Check().ok()) return;
        uint32_t* const out = inside.row(first + r).data();
        uint16_t* const ranks = state.needs_ranks ? state.inside_ranks.data() + (first + r) * lines.nx : nullptr;
        if (memory.rows.empty()) {
          if (!add) std::fill_n(out, words, 0u);
          if (ranks != nullptr) std::fill_n(ranks, lines.nx, uint16_t{0});
          continue;
        }
        std::fill(memory.painted.begin(), memory.painted.end(), 0u);
        std::fill(memory.ranks.begin(), memory.ranks.end(), uint16_t{0});
        const auto [from, to] = memory.rows.Row(r);
        uint16_t* const row_ranks = ranks == nullptr ? nullptr : memory.ranks.data();
        PaintRow(from, to, signs, memory.painted.data(), row_ranks, memory.counts);
        for (int64_t w = 0; w < words; ++w) {
          out[w] = add ? out[w] | memory.painted[size_t(w)] : memory.painted[size_t(w)];
        }
        if (ranks != nullptr) std::copy_n(memory.ranks.data(), lines.nx, ranks);
      }
    }
  });
  for (const Scratch& memory : scratch) {
    for (size_t rank = 0; rank < state.part_count(); ++rank) {
      state.counts.part_odd_columns[rank] += memory.counts.odd_columns[rank];
      state.counts.part_voxels[rank] += memory.counts.voxels[rank];
      state.counts.odd_columns += memory.counts.odd_columns[rank];
    }
  }
  return s;
}

}  // namespace voxelpipe::cpu
