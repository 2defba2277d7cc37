// Crossings of the lines along x with the triangles of each part, as sortable keys. Included by .cu files only.
//
// A key orders crossings by row, then by descending rank of the part, then by descending number of voxels before the
// crossing. Its lowest bit is the sign, which takes no part in the order.
#pragma once

#include "cuda/fill/crossings.cuh"
#include "cuda/primitives/part_order.h"

namespace voxelpipe::cuda {

// Bits of a key above the sign. Rows, ranks and voxels of a slab take less than 63 bits together, since the voxels of a
// slab are numbered in 32 bits and ranks in 16.
struct CrossingCode {
  uint32_t before_bits = 1, rank_bits = 1, row_bits = 1;
  uint32_t nx = 1, top_rank = 0;

  VOXELPIPE_HD uint32_t bits() const { return 1 + before_bits + rank_bits + row_bits; }
  VOXELPIPE_HD uint64_t Key(uint64_t row, uint32_t rank, uint32_t before, bool falls) const {
    const uint64_t part = row << rank_bits | (top_rank - rank);
    return (part << before_bits | (nx - before)) << 1 | (falls ? 1 : 0);
  }
  // The same for all crossings of a row with a part.
  VOXELPIPE_HD uint64_t Part(uint64_t key) const { return key >> (1 + before_bits); }
  VOXELPIPE_HD uint64_t Row(uint64_t key) const { return Part(key) >> rank_bits; }
  VOXELPIPE_HD uint32_t Rank(uint64_t key) const { return top_rank - (uint32_t(Part(key)) & ((1u << rank_bits) - 1)); }
  VOXELPIPE_HD uint32_t Before(uint64_t key) const { return nx - (uint32_t(key >> 1) & ((1u << before_bits) - 1)); }
};

// Lists the crossings in a range of the slab's rows, numbered as in bit grids.
struct PartCrossingArgs {
  GridView grid;
  uint64_t first_row = 0, end_row = 0;
  CrossingCode code;
  PartRuns parts;
  const uint32_t* triangles = nullptr;
  const Vec3d* positions = nullptr;  // index space
  uint64_t triangle_count = 0;
  // Triangles with more than kLinesOfThread lines, and with more than kLinesOfWarp.
  uint32_t *some = nullptr, *many = nullptr;
  uint64_t *some_count = nullptr, *many_count = nullptr;
  uint64_t* keys = nullptr;  // rows count from first_row
  uint64_t capacity = 0;
  uint64_t* count = nullptr;  // of crossings, also of those beyond the capacity
};

__device__ inline bool CrossesLine(const PartCrossingArgs& args, const Corners& t, int64_t y, int64_t z) {
  const uint64_t row = uint64_t(y + args.grid.dims[1] * (z - args.grid.slab_begin));
  return row >= args.first_row && row < args.end_row && LineCrosses(t.a, t.b, t.c, double(y) + 0.5, double(z) + 0.5);
}

// The key of a line for which CrossesLine is true.
__device__ inline uint64_t KeyOfLine(const PartCrossingArgs& args, const Corners& t, uint32_t rank, int64_t y,
                                     int64_t z) {
  const double py = double(y) + 0.5, pz = double(z) + 0.5;
  const uint64_t row = uint64_t(y + args.grid.dims[1] * (z - args.grid.slab_begin)) - args.first_row;
  const TrianglePlane plane = SetUpPlane(t.a, t.b, t.c);
  const int64_t before = CentresBefore(CrossingX(plane, t.a, t.b, t.c, py, pz), args.grid.dims[0]);
  return args.code.Key(row, rank, uint32_t(before), CrossingFalls(t.a, t.b, t.c, py, pz));
}

// The rank of a triangle's part.
__device__ inline uint32_t RankOf(const PartCrossingArgs& args, uint64_t t) {
  return args.parts.Of(t).rank - 1;
}

// One thread per triangle; those with more lines are queued. A block takes room for all its crossings at once.
__global__ void __launch_bounds__(kFillThreads) ListSmall(const __grid_constant__ PartCrossingArgs args) {
  static_assert(kLinesOfThread == 32);  // one bit each
  __shared__ unsigned long long room[3][kFillThreads / 32 + 1];
  const uint64_t t = uint64_t(blockIdx.x) * kFillThreads + threadIdx.x;
  bool some = false, many = false;
  uint32_t crossed = 0;  // by number of the line
  Corners corners;
  Lines lines{};
  if (t < args.triangle_count) {
    corners = Load(args, t);
    lines = LinesOfRows(args.grid, args.first_row, args.end_row, corners);
    const uint64_t count = lines.count();
    many = count > kLinesOfWarp;
    some = count > kLinesOfThread && !many;
    if (count > 0 && count <= kLinesOfThread) {
      uint32_t bit = 1;
      for (int64_t z = lines.z_begin; z < lines.z_end; ++z) {
        for (int64_t y = lines.y_begin; y < lines.y_end; ++y, bit <<= 1) {
          if (CrossesLine(args, corners, y, z)) crossed |= bit;
        }
      }
    }
  }
  if (__syncthreads_or(crossed != 0) != 0) {
    uint64_t at = BlockAllocate<kFillThreads>(args.count, uint32_t(__popc(crossed)), room[0]);
    if (crossed != 0) {
      const uint32_t rank = RankOf(args, t), ny = uint32_t(lines.y_end - lines.y_begin);
      for (uint32_t left = crossed; left != 0; left &= left - 1, ++at) {
        if (at >= args.capacity) break;
        const uint32_t line = uint32_t(__ffs(int(left))) - 1;
        args.keys[at] = KeyOfLine(args, corners, rank, lines.y_begin + line % ny, lines.z_begin + line / ny);
      }
    }
  }
  if (__syncthreads_or(some || many) == 0) return;
  const uint64_t at_some = BlockAllocate<kFillThreads>(args.some_count, some, room[1]);
  if (some) args.some[at_some] = uint32_t(t);
  const uint64_t at_many = BlockAllocate<kFillThreads>(args.many_count, many, room[2]);
  if (many) args.many[at_many] = uint32_t(t);
}

// One of `warps` warps that share the lines of a triangle. It takes room for 32 lines at once.
__device__ inline void ListTriangle(const PartCrossingArgs& args, uint64_t t, uint64_t warp, uint64_t warps) {
  const uint32_t lane = threadIdx.x % 32;
  const Corners corners = Load(args, t);
  const Lines lines = LinesOfRows(args.grid, args.first_row, args.end_row, corners);
  const uint64_t count = lines.count(), ny = uint64_t(lines.y_end - lines.y_begin);
  const uint32_t rank = RankOf(args, t);
  for (uint64_t first = warp * 32; first < count; first += warps * 32) {
    const uint64_t line = first + lane;
    const int64_t y = lines.y_begin + int64_t(line % ny), z = lines.z_begin + int64_t(line / ny);
    const bool crosses = line < count && CrossesLine(args, corners, y, z);
    const uint32_t crossed = __ballot_sync(~0u, crosses);
    if (crossed == 0) continue;
    unsigned long long at = 0;
    if (lane == 0) {
      at = atomicAdd(reinterpret_cast<unsigned long long*>(args.count),
                     static_cast<unsigned long long>(__popc(crossed)));
    }
    at = __shfl_sync(~0u, at, 0) + uint64_t(__popc(crossed & ((1u << lane) - 1)));
    if (crosses && at < args.capacity) args.keys[at] = KeyOfLine(args, corners, rank, y, z);
  }
}

// The triangles with more lines than a thread takes: a warp each.
__global__ void __launch_bounds__(kFillThreads) ListSome(const __grid_constant__ PartCrossingArgs args) {
  constexpr uint64_t kWarps = kFillThreads / 32;
  const uint64_t queued = *args.some_count;
  for (uint64_t i = uint64_t(blockIdx.x) * kWarps + threadIdx.x / 32; i < queued; i += uint64_t(gridDim.x) * kWarps) {
    ListTriangle(args, args.some[i], 0, 1);
  }
}

// The triangles with more lines than a warp takes: gridDim.x blocks share one, gridDim.y divides the triangles.
__global__ void __launch_bounds__(kFillThreads) ListMany(const __grid_constant__ PartCrossingArgs args) {
  constexpr uint64_t kWarps = kFillThreads / 32;
  const uint64_t queued = *args.many_count;
  for (uint64_t i = blockIdx.y; i < queued; i += gridDim.y) {
    ListTriangle(args, args.many[i], uint64_t(blockIdx.x) * kWarps + threadIdx.x / 32, uint64_t(gridDim.x) * kWarps);
  }
}

// The crossings of each row: elements [begin[row], end[row]) of the sorted keys; both 0 at first, for rows without any.
__global__ void __launch_bounds__(kFillThreads)
    FindRows(CrossingCode code, const uint64_t* keys, uint64_t count, uint32_t* begin, uint32_t* end) {
  const uint64_t step = uint64_t(gridDim.x) * kFillThreads;
  for (uint64_t i = uint64_t(blockIdx.x) * kFillThreads + threadIdx.x; i < count; i += step) {
    const uint64_t row = code.Row(keys[i]);
    if (i == 0 || code.Row(keys[i - 1]) != row) begin[row] = uint32_t(i);
    if (i + 1 == count || code.Row(keys[i + 1]) != row) end[row] = uint32_t(i) + 1;
  }
}

struct PartSweepArgs {
  CrossingCode code;
  const uint64_t* keys = nullptr;  // sorted
  const uint32_t *begin = nullptr, *end = nullptr;
  uint64_t rows = 0;
  bool signs = false;
  // Of the first row: bits of the voxels inside some part, and of each voxel the rank plus 1 of the highest one; both 0
  // at first.
  uint32_t* inside = nullptr;
  uint16_t* ranks = nullptr;
  int64_t words_per_row = 1;
  uint64_t* odd_columns = nullptr;   // sum over the parts
  uint64_t* odd_of_parts = nullptr;  // by rank
};

// The painted voxels of a row, 1024 of them in the registers of a warp. All lanes call each function.
class PaintedRow {
 public:
  __device__ PaintedRow(const PartSweepArgs& args, uint64_t row)
      : words_(args.words_per_row),
        bits_(args.inside + row * uint64_t(args.words_per_row)),
        ranks_(args.ranks + row * args.code.nx) {}

  // Paints voxels [begin, end) that are not painted yet.
  __device__ void Paint(uint32_t begin, uint32_t end, uint32_t rank) {
    const uint32_t lane = threadIdx.x % 32;
    for (int64_t first = int64_t(begin / 1024) * 32; first * 32 < int64_t{end}; first += 32) {
      Hold(first);
      const int64_t low = (first + lane) * 32;
      uint32_t fresh = ~word_;
      if (int64_t{begin} > low) fresh &= int64_t{begin} - low < 32 ? ~0u << (begin - uint32_t(low)) : 0;
      if (int64_t{end} < low + 32) fresh &= int64_t{end} > low ? ~0u >> (uint32_t(low) + 32 - end) : 0;
      word_ |= fresh;
      for (uint32_t left = __ballot_sync(~0u, fresh != 0); left != 0; left &= left - 1) {
        const int k = __ffs(int(left)) - 1;
        const uint32_t of_word = __shfl_sync(~0u, fresh, k);
        if ((of_word >> lane & 1) != 0) ranks_[(first + k) * 32 + lane] = uint16_t(rank + 1);
      }
    }
  }
  __device__ void Store() {
    const int64_t mine = held_ + threadIdx.x % 32;
    if (held_ >= 0 && mine < words_) bits_[mine] = word_;
  }

 private:
  // Has words [first, first + 32) in the registers.
  __device__ void Hold(int64_t first) {
    if (first == held_) return;
    Store();
    held_ = first;
    const int64_t mine = first + threadIdx.x % 32;
    word_ = mine < words_ ? bits_[mine] : 0;
  }

  const int64_t words_;
  uint32_t* const bits_;
  uint16_t* const ranks_;
  int64_t held_ = -1;
  uint32_t word_ = 0;
};

// Sums signs, or counts crossings, part by part from the last voxel of the row on. Paints the voxels whose centre lies
// inside of the part.
__device__ inline void SweepRow(const PartSweepArgs& args, uint64_t row) {
  const uint32_t lane = threadIdx.x % 32;
  const uint64_t begin = args.begin[row], end = args.end[row];
  if (begin == end) return;
  constexpr uint64_t kNone = ~uint64_t{0};
  PaintedRow painted(args, row);
  uint64_t carry_part = kNone;
  uint32_t carry = 0, odd = 0;
  for (uint64_t first = begin; first < end; first += 32) {
    const uint64_t i = first + lane;
    const bool has = i < end;
    const uint64_t key = has ? args.keys[i] : kNone, next = i + 1 < end ? args.keys[i + 1] : kNone;
    const uint64_t part = args.code.Part(key);
    uint32_t sum = !has ? 0 : args.signs && (key & 1) != 0 ? ~0u : 1u;
    for (unsigned by = 1; by < 32; by *= 2) {
      const uint32_t other = __shfl_up_sync(~0u, sum, by);
      const uint64_t of = __shfl_up_sync(~0u, part, by);
      if (lane >= by && of == part) sum += other;
    }
    if (part == carry_part) sum += carry;
    const bool ends_part = has && args.code.Part(next) != part, ends_place = has && next >> 1 != key >> 1;
    const bool inside = args.signs ? sum != 0 : sum % 2 != 0;
    const uint32_t before = args.code.Before(key), rank = args.code.Rank(key);
    const uint32_t after = ends_part ? 0 : args.code.Before(next);
    const bool is_odd = ends_part && inside;
    if (is_odd) atomicAdd(reinterpret_cast<unsigned long long*>(args.odd_of_parts + rank), 1ull);
    odd += uint32_t(__popc(__ballot_sync(~0u, is_odd)));
    // In order of ranks: what is painted stays.
    for (uint32_t left = __ballot_sync(~0u, ends_place && inside && after < before); left != 0; left &= left - 1) {
      const int k = __ffs(int(left)) - 1;
      const uint32_t from = __shfl_sync(~0u, after, k), to = __shfl_sync(~0u, before, k);
      painted.Paint(from, to, __shfl_sync(~0u, rank, k));
    }
    carry = __shfl_sync(~0u, sum, 31);
    carry_part = __shfl_sync(~0u, part, 31);
  }
  painted.Store();
  if (odd != 0 && lane == 0) {
    atomicAdd(reinterpret_cast<unsigned long long*>(args.odd_columns), static_cast<unsigned long long>(odd));
  }
}

// One warp per row.
__global__ void __launch_bounds__(kFillThreads) SweepRows(const __grid_constant__ PartSweepArgs args) {
  const uint64_t warps = uint64_t(gridDim.x) * (kFillThreads / 32);
  for (uint64_t row = uint64_t(blockIdx.x) * (kFillThreads / 32) + threadIdx.x / 32; row < args.rows; row += warps) {
    SweepRow(args, row);
  }
}

}  // namespace voxelpipe::cuda
