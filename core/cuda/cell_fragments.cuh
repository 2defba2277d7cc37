// The A-buffer's fragments from records of triangles (cell_views.h): counted, given room by a scan, emitted in the order of
// triangles. No host-only includes.
#pragma once

#include "cuda/cell_walk.cuh"

namespace voxelpipe::cuda {

inline constexpr int kChunkThreads = 256, kCellsOfThread = 4;
inline constexpr int kCellsOfChunk = kChunkThreads * kCellsOfThread;  // whose fragments a block counts and emits
inline constexpr int kStagedFragments = 3584;                         // of a chunk; further ones are written one by one

struct FragmentArgs {
  GridView grid;
  uint64_t* cells = nullptr;   // records
  uint64_t* blocks = nullptr;  // masks; of others, where their next fragment goes
  uint64_t triangles = 0;
  uint64_t* first = nullptr;  // of chunks, and one more
  uint32_t *keys = nullptr, *values = nullptr;
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

// first[chunk] becomes the number of its fragments.
__global__ void __launch_bounds__(kChunkThreads) CountCells(const __grid_constant__ FragmentArgs args) {
  __shared__ uint64_t sums[kChunkThreads / 32];
  const uint64_t begin = uint64_t(blockIdx.x) * kCellsOfChunk;
  uint64_t sum = 0;
#pragma unroll
  for (int i = 0; i < kCellsOfThread; ++i) {
    const uint64_t t = begin + uint64_t(i) * kChunkThreads + threadIdx.x;
    if (t < args.triangles) sum += FragmentsOf(args, t, args.cells[t]);
  }
  for (int step = 16; step > 0; step /= 2) sum += __shfl_down_sync(~0u, sum, step);
  if (threadIdx.x % 32 == 0) sums[threadIdx.x / 32] = sum;
  __syncthreads();
  if (threadIdx.x > 0) return;
  for (int w = 1; w < kChunkThreads / 32; ++w) sum += sums[w];
  args.first[blockIdx.x] = sum;
}

// An exclusive scan in place, by one block; sums[count] becomes the total.
inline constexpr int kScanThreads = 1024;
__global__ void __launch_bounds__(kScanThreads) ScanChunks(uint64_t* sums, uint64_t count) {
  __shared__ uint64_t before[kScanThreads];
  const uint64_t each = (count + kScanThreads - 1) / kScanThreads;
  const uint64_t begin = min(count, threadIdx.x * each), end = min(count, begin + each);
  uint64_t sum = 0;
  for (uint64_t i = begin; i < end; ++i) sum += sums[i];
  before[threadIdx.x] = sum;
  __syncthreads();
  for (int step = 1; step < kScanThreads; step *= 2) {
    const uint64_t there = int(threadIdx.x) >= step ? before[threadIdx.x - unsigned(step)] : 0;
    __syncthreads();
    before[threadIdx.x] += there;
    __syncthreads();
  }
  uint64_t at = before[threadIdx.x] - sum;
  for (uint64_t i = begin; i < end; ++i) {
    const uint64_t here = sums[i];
    sums[i] = at;
    at += here;
  }
  if (threadIdx.x == kScanThreads - 1) sums[count] = before[threadIdx.x];
}

// The fragments of a chunk's triangles, a triangle's in a row; of those that wait only where they go.
__global__ void __launch_bounds__(kChunkThreads) EmitCells(const __grid_constant__ FragmentArgs args) {
  __shared__ uint32_t keys[kStagedFragments], values[kStagedFragments];
  __shared__ uint64_t sums[kChunkThreads / 32];
  const uint64_t begin = uint64_t(blockIdx.x) * kCellsOfChunk + uint64_t(threadIdx.x) * kCellsOfThread;
  uint64_t cell[kCellsOfThread] = {};
  if (begin + kCellsOfThread <= args.triangles) {
#pragma unroll
    for (int i = 0; i < kCellsOfThread; i += 2) {
      const ulonglong2 two = *reinterpret_cast<const ulonglong2*>(args.cells + begin + i);
      cell[i] = two.x, cell[i + 1] = two.y;
    }
  } else {
#pragma unroll
    for (int i = 0; i < kCellsOfThread; ++i) {
      if (begin + uint64_t(i) < args.triangles) cell[i] = args.cells[begin + uint64_t(i)];
    }
  }
  uint64_t mine = 0;
#pragma unroll
  for (int i = 0; i < kCellsOfThread; ++i) mine += FragmentsOf(args, begin + uint64_t(i), cell[i]);
  uint64_t sum = mine;
  const unsigned lane = threadIdx.x % 32, warp = threadIdx.x / 32;
  for (unsigned step = 1; step < 32; step *= 2) {
    const uint64_t below = __shfl_up_sync(~0u, sum, step);
    if (lane >= step) sum += below;
  }
  if (lane == 31) sums[warp] = sum;
  __syncthreads();
  uint64_t at = sum - mine, total = 0;  // within the chunk
#pragma unroll
  for (unsigned w = 0; w < kChunkThreads / 32; ++w) {
    if (w < warp) at += sums[w];
    total += sums[w];
  }
  const uint64_t base = args.first[blockIdx.x];
  const auto layer = uint32_t(args.grid.words_per_row) * 32 * uint32_t(args.grid.dims[1]);
  const auto put = [&](uint64_t t, uint32_t bit) {
    const uint32_t key = KeyOfBit(args.grid, bit);
    if (at < uint64_t(kStagedFragments)) {
      keys[at] = key;
      values[at] = uint32_t(t);
    } else {
      args.keys[base + at] = key;
      args.values[base + at] = uint32_t(t);
    }
    ++at;
  };
  bool gaps = false;
#pragma unroll
  for (int i = 0; i < kCellsOfThread; ++i) {
    const uint64_t t = begin + uint64_t(i);
    const uint32_t first = FirstOfCell(cell[i]);
    switch (KindOfCell(cell[i])) {
      case CellKind::kOctants:
        for (uint32_t left = OctantsOfCell(cell[i]); left != 0; left &= left - 1) {
          put(t, BitOfOctant(args.grid, first, __ffs(int(left)) - 1));
        }
        break;
      case CellKind::kBlock:
        for (uint64_t left = args.blocks[t]; left != 0; left &= left - 1) {
          const auto n = uint32_t(__ffsll(static_cast<long long>(left)) - 1);
          put(t, first + n % 4 + n / 4 % 4 * (uint32_t(args.grid.words_per_row) * 32) + n / 16 * layer);
        }
        break;
      default:
        args.blocks[t] = base + at;
        // Others write there: what is staged leaves it out.
        gaps = gaps || first > 0;
        for (uint64_t k = at; k < min(at + first, uint64_t{kStagedFragments}); ++k) values[k] = ~0u;
        at += first;
    }
  }
  gaps = __syncthreads_or(gaps) != 0;
  const auto staged = uint32_t(min(total, uint64_t{kStagedFragments}));
  for (uint32_t i = threadIdx.x; i < staged; i += kChunkThreads) {
    if (gaps && values[i] == ~0u) continue;
    args.keys[base + i] = keys[i];
    args.values[base + i] = values[i];
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

// Adds to the records of those that wait how many fragments they have.
class FragmentCounter {
 public:
  using Args = FragmentArgs;
  __device__ explicit FragmentCounter(const FragmentArgs& args) : args_(args) {}
  __device__ void Put(uint32_t t, uint32_t, int x_begin, int x_end) {
    const LanesOfPut put = LookAtPut(t, x_begin, x_end);
    if (put.leader < 0) return;
    uint32_t count = put.count;
    if (put.one_triangle) {
      count = __reduce_add_sync(~0u, count);
      if (int(threadIdx.x % 32) != put.leader) return;
    }
    if (count > 0) atomicAdd(reinterpret_cast<uint32_t*>(args_.cells + t), count);  // the low half
  }
  __device__ void Finish() {}

 private:
  const FragmentArgs& args_;
};

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

// ---- buckets ----

inline constexpr int kKeysOfThread = 16, kKeysOfChunk = kChunkThreads * kKeysOfThread;

struct BucketArgs {
  const uint32_t* keys = nullptr;  // sorted
  uint64_t fragments = 0;
  uint64_t first_voxel = 0;   // of the slab
  uint64_t* first = nullptr;  // of chunks of fragments: how many voxels begin before it; and one more
  uint64_t *offsets = nullptr, *voxels = nullptr;
};

// Which of a thread's keys begin a voxel: bit i is that of key i.
__device__ inline uint32_t FindHeads(const BucketArgs& args, uint64_t begin, uint32_t (&key)[kKeysOfThread]) {
  if (begin >= args.fragments) return 0;
  const auto here = uint32_t(min(args.fragments - begin, uint64_t{kKeysOfThread}));
#pragma unroll
  for (int i = 0; i < kKeysOfThread; i += 4) {
    uint4 four{0, 0, 0, 0};
    if (uint32_t(i) < here)
      four = *reinterpret_cast<const uint4*>(args.keys + begin + uint64_t(i));  // whole units of 16 bytes
    key[i] = four.x, key[i + 1] = four.y, key[i + 2] = four.z, key[i + 3] = four.w;
  }
  uint32_t heads = begin == 0 || args.keys[begin - 1] != key[0] ? 1 : 0;
#pragma unroll
  for (int i = 1; i < kKeysOfThread; ++i) heads |= key[i] != key[i - 1] ? 1u << i : 0;
  return heads & (here == uint32_t(kKeysOfThread) ? ~0u : (1u << here) - 1);
}

// first[chunk] becomes the number of voxels that begin there.
__global__ void __launch_bounds__(kChunkThreads) CountHeads(const __grid_constant__ BucketArgs args) {
  __shared__ uint32_t sums[kChunkThreads / 32];
  uint32_t key[kKeysOfThread];
  const uint64_t begin = uint64_t(blockIdx.x) * kKeysOfChunk + uint64_t(threadIdx.x) * kKeysOfThread;
  uint32_t sum = __reduce_add_sync(~0u, uint32_t(__popc(FindHeads(args, begin, key))));
  if (threadIdx.x % 32 == 0) sums[threadIdx.x / 32] = sum;
  __syncthreads();
  if (threadIdx.x > 0) return;
  for (int w = 1; w < kChunkThreads / 32; ++w) sum += sums[w];
  args.first[blockIdx.x] = sum;
}

// Voxels and the offsets of their fragments; after the last voxel stands the number of all fragments.
__global__ void __launch_bounds__(kChunkThreads) WriteBuckets(const __grid_constant__ BucketArgs args) {
  __shared__ uint32_t sums[kChunkThreads / 32];
  __shared__ uint32_t keys[kKeysOfChunk];
  __shared__ uint16_t places[kKeysOfChunk];
  uint32_t key[kKeysOfThread];
  const uint64_t chunk = uint64_t(blockIdx.x) * kKeysOfChunk;
  const uint32_t heads = FindHeads(args, chunk + uint64_t(threadIdx.x) * kKeysOfThread, key);
  uint32_t in_warp;
  uint32_t at = WarpExclusiveSum(uint32_t(__popc(heads)), in_warp), total = 0;
  if (threadIdx.x % 32 == 0) sums[threadIdx.x / 32] = in_warp;
  __syncthreads();
#pragma unroll
  for (unsigned w = 0; w < kChunkThreads / 32; ++w) {
    if (w < threadIdx.x / 32) at += sums[w];
    total += sums[w];
  }
#pragma unroll
  for (int i = 0; i < kKeysOfThread; ++i) {
    if ((heads >> i & 1) == 0) continue;
    keys[at] = key[i];
    places[at] = uint16_t(threadIdx.x * kKeysOfThread + unsigned(i));
    ++at;
  }
  __syncthreads();
  const uint64_t to = args.first[blockIdx.x];
  for (uint32_t i = threadIdx.x; i < total; i += kChunkThreads) {
    args.offsets[to + i] = chunk + places[i];
    args.voxels[to + i] = args.first_voxel + keys[i];
  }
  if (blockIdx.x + 1 == gridDim.x && threadIdx.x == 0) args.offsets[to + total] = args.fragments;
}

}  // namespace voxelpipe::cuda
