// The A-buffer's fragments from records of triangles (cell_views.h): counted, given room by a scan, emitted in the order of
// triangles. No host-only includes.
#pragma once

#include "cuda/cell_walk.cuh"
#include "cuda/span_kernels.cuh"
#include "cuda/warp_sum.cuh"

namespace voxelpipe::cuda {

inline constexpr int kChunkThreads = 256, kCellsOfThread = 2;
inline constexpr int kCellsAtOnce = kChunkThreads * kCellsOfThread;  // whose fragments a block emits together
inline constexpr int kStagedFragments = 4096;                        // of those; where they have more none is staged

struct FragmentArgs {
  GridView grid;
  uint64_t* cells = nullptr;   // records
  uint64_t* blocks = nullptr;  // masks; of others, where their next fragment goes
  uint64_t triangles = 0;
  uint64_t* first = nullptr;  // of chunks of records: how many fragments, then where they begin; and one more
  uint32_t of_chunk = 1;      // records
  uint32_t *keys = nullptr, *values = nullptr;
  // What waits as a list (span_views.h), if it has room for all.
  uint64_t* spans = nullptr;
  uint64_t capacity = 0;
  uint64_t* span_count = nullptr;
};

__device__ inline uint32_t FragmentsOf(const FragmentArgs& args, uint64_t t, uint64_t cell) {
  switch (KindOfCell(cell)) {
    case CellKind::kOctants: return uint32_t(__popc(OctantsOfCell(cell)));
    case CellKind::kBlock: return uint32_t(__popcll(args.blocks[t]));
    default: return FirstOfCell(cell);
  }
}

// The voxel of a bit of a grid: its index within the slab.
__device__ inline uint32_t KeyOfBit(const GridView& grid, uint32_t bit) {
  const auto words = uint32_t(grid.words_per_row), nx = uint32_t(grid.dims[0]);
  if (nx == words * 32) return bit;
  const uint32_t row = bit / 32 / words;
  return row * nx + (bit - row * words * 32);
}

struct EmitRoom {
  uint32_t bits[kStagedFragments], values[kStagedFragments];
  uint64_t sums[kChunkThreads / 32];
};

// The fragments of a thread's records from `at` on, a triangle's in a row: put(at, triangle, bit); of those that wait only where
// they go, `base` from where `at` counts: skip(at, how many).
template <typename Put, typename Skip>
__device__ inline void ForEachFragment(const FragmentArgs& args, const uint64_t (&cell)[kCellsOfThread], uint64_t begin,
                                       uint64_t base, uint64_t at, Put&& put, Skip&& skip) {
  const auto row = uint32_t(args.grid.words_per_row) * 32, layer = row * uint32_t(args.grid.dims[1]);
#pragma unroll
  for (int i = 0; i < kCellsOfThread; ++i) {
    const uint64_t t = begin + uint64_t(i);
    const uint32_t first = FirstOfCell(cell[i]);
    switch (KindOfCell(cell[i])) {
      case CellKind::kOctants:
        for (uint32_t left = OctantsOfCell(cell[i]); left != 0; left &= left - 1) {
          const auto n = uint32_t(__ffs(int(left)) - 1);
          put(at++, t, first + (n & 1) + (n >> 1 & 1) * row + (n >> 2) * layer);
        }
        break;
      case CellKind::kBlock:
        for (uint64_t left = args.blocks[t]; left != 0; left &= left - 1) {
          const auto n = uint32_t(__ffsll(static_cast<long long>(left)) - 1);
          put(at++, t, first + (n & 3) + (n >> 2 & 3) * row + (n >> 4) * layer);
        }
        break;
      default:
        args.blocks[t] = base + at;
        skip(at, first);
        at += first;
    }
  }
}

// The fragments of a chunk's triangles.
__global__ void __launch_bounds__(kChunkThreads) EmitCells(const __grid_constant__ FragmentArgs args) {
  __shared__ EmitRoom room;
  const unsigned lane = threadIdx.x % 32, warp = threadIdx.x / 32;
  const uint64_t chunk = uint64_t(blockIdx.x) * args.of_chunk, end = min(args.triangles, chunk + args.of_chunk);
  uint64_t base = args.first[blockIdx.x];
  for (uint64_t cells = chunk; cells < end; cells += kCellsAtOnce) {
    const uint64_t begin = cells + uint64_t(threadIdx.x) * kCellsOfThread;
    uint64_t cell[kCellsOfThread] = {};
    if (begin + kCellsOfThread <= end) {
#pragma unroll
      for (int i = 0; i < kCellsOfThread; i += 2) {
        const ulonglong2 two = *reinterpret_cast<const ulonglong2*>(args.cells + begin + i);
        cell[i] = two.x, cell[i + 1] = two.y;
      }
    } else {
#pragma unroll
      for (int i = 0; i < kCellsOfThread; ++i) {
        if (begin + uint64_t(i) < end) cell[i] = args.cells[begin + uint64_t(i)];
      }
    }
    uint64_t mine = 0;
#pragma unroll
    for (int i = 0; i < kCellsOfThread; ++i) mine += FragmentsOf(args, begin + uint64_t(i), cell[i]);
    uint64_t sum = mine;
    for (unsigned step = 1; step < 32; step *= 2) {
      const uint64_t below = __shfl_up_sync(~0u, sum, step);
      if (lane >= step) sum += below;
    }
    if (lane == 31) room.sums[warp] = sum;
    __syncthreads();
    uint64_t at = sum - mine, total = 0;
#pragma unroll
    for (unsigned w = 0; w < kChunkThreads / 32; ++w) {
      if (w < warp) at += room.sums[w];
      total += room.sums[w];
    }
    if (total <= uint64_t{kStagedFragments}) {
      ForEachFragment(
          args, cell, begin, base, at,
          [&](uint64_t to, uint64_t t, uint32_t bit) {
            room.bits[uint32_t(to)] = bit;
            room.values[uint32_t(to)] = uint32_t(t);
          },
          [&](uint64_t to, uint32_t count) {  // others write there
            for (uint32_t k = 0; k < count; ++k) room.values[uint32_t(to) + k] = ~0u;
          });
      __syncthreads();
      for (uint32_t i = threadIdx.x; i < uint32_t(total); i += kChunkThreads) {
        const uint32_t t = room.values[i];
        if (t == ~0u) continue;
        args.keys[base + i] = KeyOfBit(args.grid, room.bits[i]);
        args.values[base + i] = t;
      }
    } else {
      ForEachFragment(
          args, cell, begin, base, at,
          [&](uint64_t to, uint64_t t, uint32_t bit) {
            args.keys[base + to] = KeyOfBit(args.grid, bit);
            args.values[base + to] = uint32_t(t);
          },
          [](uint64_t, uint32_t) {});
    }
    base += total;
    __syncthreads();  // the room is free again
  }
}

// Writers of span_kernels.cuh. All lanes call Put together; most often they have rows of one triangle.
struct LanesOfPut {
  uint32_t count;     // of this lane
  bool one_triangle;  // of all lanes that have any
  int leader;         // one of those; -1: there is none
};
__device__ inline LanesOfPut LookAtPut(uint32_t t, int x_begin, int x_end) {
  LanesOfPut put;
  put.count = uint32_t(x_end - x_begin);
  const uint32_t lanes = __ballot_sync(~0u, put.count > 0);
  put.leader = __ffs(int(lanes)) - 1;
  const uint32_t theirs = __shfl_sync(~0u, t, max(put.leader, 0));
  put.one_triangle = __all_sync(~0u, put.count == 0 || t == theirs) != 0;
  return put;
}

// Adds to the records of those that wait, and to their chunks, how many fragments they have, and lists them.
class FragmentCounter {
 public:
  using Args = FragmentArgs;
  __device__ explicit FragmentCounter(const FragmentArgs& args)
      : args_(args), list_(args.spans, args.capacity, args.span_count, kNoSpan) {}
  __device__ void Put(uint32_t t, uint32_t row, int x_begin, int x_end) {
    const LanesOfPut put = LookAtPut(t, x_begin, x_end);
    if (put.leader < 0) return;
    const uint32_t all = WarpSum(put.count);
    if (!put.one_triangle) {
      if (put.count > 0) Add(t, put.count);
    } else if (int(threadIdx.x % 32) == put.leader) {
      Add(t, all);
    }
    ForEachSpan(args_.grid, t, row, x_begin, x_end, [&](uint32_t lanes, uint64_t span) { list_.Put(lanes, span); });
  }
  __device__ void Finish() {
    __syncwarp();
    list_.Close();
  }

 private:
  const FragmentArgs& args_;
  PieceWriter<uint64_t, kSpansOfPiece> list_;

  __device__ void Add(uint32_t t, uint32_t count) const {
    atomicAdd(reinterpret_cast<uint32_t*>(args_.cells + t), count);  // the low half
    atomicAdd(reinterpret_cast<unsigned long long*>(args_.first + t / args_.of_chunk), 0ull + count);
  }
};

// The listed spans to fragments.
__global__ void __launch_bounds__(kChunkThreads) EmitListed(const __grid_constant__ FragmentArgs args) {
  const uint64_t count = *args.span_count;
  const uint64_t threads = uint64_t(gridDim.x) * kChunkThreads;
  for (uint64_t begin = uint64_t(blockIdx.x) * kChunkThreads + threadIdx.x / 32 * 32; begin < count; begin += threads) {
    const uint64_t i = begin + threadIdx.x % 32, span = i < count ? args.spans[i] : kNoSpan;
    const uint32_t t = SpanTriangle(span), length = span == kNoSpan ? 0 : SpanLength(span);
    const LanesOfPut put = LookAtPut(t, 0, int(length));
    if (put.leader < 0) continue;
    unsigned long long at = 0;
    if (put.one_triangle) {
      uint32_t total;
      const uint32_t before = WarpExclusiveSum(length, total);
      if (int(threadIdx.x % 32) == put.leader) {
        at = atomicAdd(reinterpret_cast<unsigned long long*>(args.blocks + t), 0ull + total);
      }
      at = __shfl_sync(~0u, at, put.leader) + before;
    } else if (length > 0) {
      at = atomicAdd(reinterpret_cast<unsigned long long*>(args.blocks + t), 0ull + length);
    }
    const uint32_t key = length > 0 ? KeyOfBit(args.grid, SpanFirst(span)) : 0;
    for (uint32_t x = 0; x < length; ++x) {
      args.keys[at + x] = key + x;
      args.values[at + x] = t;
    }
  }
}

// Writes them where EmitCells says.
class FragmentWriter {
 public:
  using Args = FragmentArgs;
  __device__ explicit FragmentWriter(const FragmentArgs& args) : args_(args) {}
  __device__ void Put(uint32_t t, uint32_t row, int x_begin, int x_end) {
    const LanesOfPut put = LookAtPut(t, x_begin, x_end);
    if (put.leader < 0) return;
    unsigned long long at = 0;
    if (put.one_triangle) {
      uint32_t total;
      const uint32_t before = WarpExclusiveSum(put.count, total);
      if (int(threadIdx.x % 32) == put.leader) at = Reserve(t, total);
      at = __shfl_sync(~0u, at, put.leader) + before;
    } else if (put.count > 0) {
      at = Reserve(t, put.count);
    }
    const uint32_t key = row * uint32_t(args_.grid.dims[0]);
    for (int x = x_begin; x < x_end; ++x, ++at) {
      args_.keys[at] = key + uint32_t(x);
      args_.values[at] = t;
    }
  }
  __device__ void Finish() {}

 private:
  const FragmentArgs& args_;

  __device__ unsigned long long Reserve(uint32_t t, uint32_t count) const {
    return atomicAdd(reinterpret_cast<unsigned long long*>(args_.blocks + t), 0ull + count);
  }
};

}  // namespace voxelpipe::cuda
