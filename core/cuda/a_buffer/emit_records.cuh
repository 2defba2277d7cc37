// Emits the A-buffer's fragments from coverage records (coverage_record.h), in triangle order. FindCells counted them;
// a block's output offset is the sum of the counts before it. No host-only includes.
#pragma once

#include "cuda/coverage/coverage_pass.cuh"
#include "cuda/coverage/emit_spans.cuh"
#include "cuda/primitives/warp_reduce.cuh"

namespace voxelpipe::cuda {

inline constexpr int kChunkThreads = 256, kChunkWarps = kChunkThreads / 32, kCellsOfThread = 2;
inline constexpr uint32_t kCellsAtOnce = kChunkThreads * kCellsOfThread;  // triangles per iteration of a block
// Capacity of the staging buffer; an iteration with more bypasses it.
inline constexpr uint32_t kStagedFragments = 4096;
inline constexpr uint32_t kNotHere = ~0u;           // placeholder of a fragment that another kernel writes

struct FragmentArgs {
  GridView grid;
  uint64_t* cells = nullptr;   // records
  uint64_t* blocks = nullptr;  // block masks; for deferred triangles the output position of their next fragment
  uint64_t triangles = 0;
  FragmentCounts counts;
  uint32_t *keys = nullptr, *values = nullptr;
  uint64_t room = 0;          // capacity in fragments; those beyond are not written
  SpanList list;              // spans of deferred triangles, if they all fit
  uint64_t* clear = nullptr;  // `clear_count` elements that EmitCells or EmitBundles sets to 0 for a later kernel
  uint64_t clear_count = 0;
};

// Voxel index within the slab of a bit index of the grid.
__device__ inline uint32_t KeyOfBit(const GridView& grid, uint32_t bit) {
  const auto words = uint32_t(grid.words_per_row), nx = uint32_t(grid.dims[0]);
  if (nx == words * 32) return bit;
  const uint32_t row = bit / 32 / words;
  return row * nx + (bit - row * words * 32);
}

// Bit-index distances to the next row and to the next layer.
struct BitSteps {
  uint32_t row, layer;

  __device__ explicit BitSteps(const GridView& grid)
      : row(uint32_t(grid.words_per_row) * 32), layer(row * uint32_t(grid.dims[1])) {}
};

// Calls put(bit index) for the voxels of a 2x2x2 record; none for a deferred triangle.
template <typename Put>
__device__ inline void ForEachOctant(const BitSteps& steps, uint64_t cell, Put&& put) {
  const uint32_t octants = OctantsOfCell(cell), first = FirstOfCell(cell);
#pragma unroll
  for (uint32_t pair = 0; pair < 4; ++pair) {  // no loop over set bits: it would diverge
    const uint32_t at = first + ((pair & 1) != 0 ? steps.row : 0) + ((pair & 2) != 0 ? steps.layer : 0);
    if ((octants >> 2 * pair & 1) != 0) put(at);
    if ((octants >> 2 * pair & 2) != 0) put(at + 1);
  }
}
template <typename Put>
__device__ inline void ForEachOfBlock(const BitSteps& steps, uint64_t cell, uint64_t mask, Put&& put) {
  uint32_t first = FirstOfCell(cell);
  for (int half = 0; half < 2; ++half, mask >>= 32, first += 2 * steps.layer) {
    for (auto left = uint32_t(mask); left != 0; left &= left - 1) {
      const auto n = uint32_t(__ffs(int(left)) - 1);
      put(first + (n & 3) + (n >> 2 & 3) * steps.row + (n >> 4) * steps.layer);
    }
  }
}

// Shared memory of a block. Warp sums are written and read between two barriers.
struct EmitRoom {
  // Staged fragments: bit index, and triangle relative to the block's first. Placeholders of deferred triangles have
  // kNotHere as the triangle; the first one of each has its triangle in place of the bit index, the others kNotHere.
  uint2 staged[kStagedFragments];
  uint64_t before[kChunkWarps];
  uint32_t sums[kChunkWarps];
  uint64_t long_sums[kChunkWarps];
};

// Number of fragments in the chunks before this block's. All threads of the block call it.
__device__ inline uint64_t FragmentsBefore(const FragmentCounts& counts, EmitRoom& room) {
  const uint32_t group = blockIdx.x / counts.chunks_of_group, in_group = blockIdx.x - group * counts.chunks_of_group;
  static_assert(kChunkGroups <= kChunkThreads);
  uint64_t sum = threadIdx.x < group ? counts.of_groups[threadIdx.x] : 0;
  for (uint32_t c = threadIdx.x; c < in_group; c += kChunkThreads) sum += counts.of_block[blockIdx.x - 1 - c];
  sum = WarpSum(sum);
  if (threadIdx.x % 32 == 0) room.before[threadIdx.x / 32] = sum;
  __syncthreads();
  SumOfWarps(room.before, sum);
  return sum;
}

// The records that a thread processes at a time, with their block masks.
struct CellsOfThread {
  uint64_t cell[kCellsOfThread] = {}, mask[kCellsOfThread] = {};

  __device__ bool waits(int i) const { return KindOfCell(cell[i]) == CellKind::kOther; }
  __device__ uint32_t count(int i) const {
    return waits(i) ? FirstOfCell(cell[i]) : uint32_t(__popc(OctantsOfCell(cell[i])) + __popcll(mask[i]));
  }
  // Number of all fragments, with each triangle's count limited to `most`.
  __device__ uint32_t few(uint32_t most) const {
    uint32_t sum = 0;
#pragma unroll
    for (int i = 0; i < kCellsOfThread; ++i) sum += min(count(i), most);
    return sum;
  }
  __device__ uint64_t all() const {
    uint64_t sum = 0;
    for (int i = 0; i < kCellsOfThread; ++i) sum += count(i);
    return sum;
  }
};

// Stages the fragments of a thread's records from `to` on. `local`: the first record's triangle, relative to the
// block's first.
__device__ inline void StageCells(const BitSteps& steps, const CellsOfThread& of, uint32_t local, uint2* to) {
#pragma unroll
  for (int i = 0; i < kCellsOfThread; ++i) {
    const uint32_t t = local + uint32_t(i);
    const auto put = [&](uint32_t bit) { *to++ = uint2{bit, t}; };
    ForEachOctant(steps, of.cell[i], put);
    if (of.mask[i] != 0) ForEachOfBlock(steps, of.cell[i], of.mask[i], put);
    const uint32_t waiting = of.waits(i) ? FirstOfCell(of.cell[i]) : 0;
    for (uint32_t k = 0; k < waiting; ++k) *to++ = uint2{k == 0 ? t : kNotHere, kNotHere};
  }
}

// Writes the fragments of a thread's records to global memory from `at` on. `first`: the first record's triangle.
__device__ inline void EmitCellsAt(const FragmentArgs& args, uint64_t first, const CellsOfThread& of, uint64_t at) {
  const BitSteps steps(args.grid);
  for (int i = 0; i < kCellsOfThread; ++i) {
    if (of.waits(i)) {
      args.blocks[first + uint64_t(i)] = at;  // a later kernel writes them there
      at += FirstOfCell(of.cell[i]);
      continue;
    }
    const auto put = [&](uint32_t bit) {
      args.keys[at] = KeyOfBit(args.grid, bit);
      args.values[at++] = uint32_t(first) + uint32_t(i);
    };
    ForEachOctant(steps, of.cell[i], put);
    ForEachOfBlock(steps, of.cell[i], of.mask[i], put);
  }
}

// Fallback for an iteration whose fragments exceed the staging buffer: writes them directly. Returns their number over
// the block.
__device__ __noinline__ inline uint64_t EmitPlainly(const FragmentArgs& args, EmitRoom& room, uint64_t first,
                                                    CellsOfThread of, uint64_t out) {
  const uint64_t mine = of.all(), upto = SumUpto(mine);
  if (threadIdx.x % 32 == 31) room.long_sums[threadIdx.x / 32] = upto;
  __syncthreads();
  uint64_t total;
  const uint64_t at = out + SumOfWarps(room.long_sums, total) + upto - mine;
  if (out + total <= args.room) EmitCellsAt(args, first, of, at);
  return total;
}

// Emits the fragments of all records. A block takes the chunk of a block of FindCells. Supports programmatic dependent
// launch.
__global__ void __launch_bounds__(kChunkThreads, 6) EmitCells(const __grid_constant__ FragmentArgs args) {
  __shared__ EmitRoom room;
  AllowNext();
  AwaitEarlier();
  if (threadIdx.x == 0) {
    for (uint64_t i = blockIdx.x; i < args.clear_count; i += gridDim.x) args.clear[i] = 0;
  }
  const uint64_t chunk = uint64_t(blockIdx.x) * args.counts.of_chunk;
  const auto here = uint32_t(min(args.triangles - chunk, uint64_t{args.counts.of_chunk}));
  const uint64_t *const cells = args.cells + chunk, *const blocks = args.blocks + chunk;
  const BitSteps steps(args.grid);
  const auto load = [&](uint64_t(&to)[kCellsOfThread], uint32_t local) {
#pragma unroll
    for (int i = 0; i < kCellsOfThread; ++i) to[i] = local + uint32_t(i) < here ? cells[local + uint32_t(i)] : 0;
  };
  uint64_t next[kCellsOfThread];
  load(next, threadIdx.x * kCellsOfThread);
  uint64_t out = FragmentsBefore(args.counts, room);
  for (uint32_t begin = 0; begin < here; begin += kCellsAtOnce) {
    const uint32_t local = begin + threadIdx.x * kCellsOfThread;
    CellsOfThread of;
#pragma unroll
    for (int i = 0; i < kCellsOfThread; ++i) {
      of.cell[i] = next[i];
      if (KindOfCell(of.cell[i]) == CellKind::kBlock) of.mask[i] = blocks[local + uint32_t(i)];
    }
    load(next, local + kCellsAtOnce);
    const uint32_t mine = of.few(kStagedFragments + 1), upto = SumUpto(mine);
    if (threadIdx.x % 32 == 31) room.sums[threadIdx.x / 32] = upto;
    __syncthreads();  // the staged fragments of the previous iteration are written
    uint32_t total;
    const uint32_t before = SumOfWarps(room.sums, total) + upto - mine;
    if (total > kStagedFragments) {
      out += EmitPlainly(args, room, chunk + local, of, out);
      __syncthreads();
      continue;
    }
    if (out + total > args.room) return;
    if (mine > 0) StageCells(steps, of, local, room.staged + before);
    __syncthreads();
    uint32_t *const keys = args.keys + out, *const values = args.values + out;
    for (uint32_t k = threadIdx.x; k < total; k += kChunkThreads) {
      const uint2 fragment = room.staged[k];
      if (fragment.y != kNotHere) {
        keys[k] = KeyOfBit(args.grid, fragment.x);
        values[k] = uint32_t(chunk) + fragment.y;
      } else if (fragment.x != kNotHere) {
        args.blocks[chunk + fragment.x] = out + k;  // a later kernel writes them there
      }
    }
    out += total;
  }
}

// The lanes of a Put call of a row writer (emit_spans.cuh). All lanes call Put together, usually with rows of one
// triangle.
struct LanesOfPut {
  uint32_t count;     // all lanes with rows have the same triangle
  bool one_triangle;  // of all lanes that have any
  int leader;         // one of these lanes; -1 if there is none
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

// A row writer that adds the fragment counts of deferred triangles to their records and chunks, and lists the spans.
// Contention on the counters dominates, so a warp combines the counts of one triangle and adds them when the triangle
// changes.
class FragmentCounter {
 public:
  using Args = FragmentArgs;
  static constexpr bool kPartsInRow = true;  // contiguous parts, so that a warp mostly appends spans of one triangle
  __device__ FragmentCounter(const FragmentArgs& args, uint32_t number) : args_(args), list_(args.list, number) {}
  __device__ void Put(uint32_t t, uint32_t row, int x_begin, int x_end) {
    const LanesOfPut put = LookAtPut(t, x_begin, x_end);
    if (put.leader < 0) return;
    if (!put.one_triangle) {
      AddRuns(t, put.count);
    } else {
      const uint32_t all = WarpSum(put.count), theirs = __shfl_sync(~0u, t, put.leader);
      if (theirs != triangle_ || counted_ > UINT32_MAX - all) Flush();
      triangle_ = theirs;
      counted_ += all;
    }
    ForEachSpan(args_.grid, t, row, x_begin, x_end, [&](uint32_t lanes, uint64_t span) { list_.Put(lanes, span); });
  }
  __device__ void Finish() {
    __syncwarp();
    Flush();
    list_.Close();
  }

 private:
  const FragmentArgs& args_;
  SpanListWriter list_;
  uint32_t triangle_ = 0, counted_ = 0;  // uniform over the warp

  __device__ void Flush() {
    if (counted_ > 0 && threadIdx.x % 32 == 0) Add(triangle_, counted_);
    counted_ = 0;
  }
  // Lanes of one triangle are adjacent; the first of them adds the sum.
  __device__ void AddRuns(uint32_t t, uint32_t count) const {
    const unsigned lane = threadIdx.x % 32;
    const uint32_t left = __shfl_up_sync(~0u, t, 1);
    const bool first = lane == 0 || left != t;
    const uint32_t heads = __ballot_sync(~0u, first), above = heads & ~((2u << lane) - 1);
    const uint32_t upto = SumUpto(count);
    const uint32_t all = __shfl_sync(~0u, upto, above == 0 ? 31 : __ffs(int(above)) - 2) - (upto - count);
    if (first && all > 0) Add(t, all);
  }
  __device__ void Add(uint32_t t, uint32_t count) const {
    const FragmentCounts& counts = args_.counts;
    const uint32_t chunk = t / counts.of_chunk;
    atomicAdd(reinterpret_cast<uint32_t*>(args_.cells + t), count);  // the low 32 bits of the record
    atomicAdd(Counted(counts.of_block + chunk), 0ull + count);
    atomicAdd(Counted(counts.of_groups + chunk / counts.chunks_of_group), 0ull + count);
  }
};

// Number of all fragments. All threads of a warp call it.
__device__ inline uint64_t AllFragments(const FragmentCounts& counts) {
  uint64_t all = 0;
  for (uint32_t g = threadIdx.x % 32; g < uint32_t(kChunkGroups); g += 32) all += counts.of_groups[g];
  return WarpSum(all);
}

// Reserves output for `length` fragments of each lane's triangle t, with one atomic per warp if possible. Returns the
// position. All threads of a warp call it.
__device__ inline uint64_t ReserveByWarps(const FragmentArgs& args, uint32_t t, uint32_t length) {
  const auto reserve = [&](uint32_t count) {
    return atomicAdd(reinterpret_cast<unsigned long long*>(args.blocks + t), 0ull + count);
  };
  const LanesOfPut put = LookAtPut(t, 0, int(length));
  if (put.leader < 0) return 0;
  if (!put.one_triangle) return length > 0 ? reserve(length) : 0;
  uint32_t total;
  const uint32_t before = WarpExclusiveSum(length, total);
  unsigned long long at = 0;
  if (int(threadIdx.x % 32) == put.leader) at = reserve(total);
  return __shfl_sync(~0u, at, put.leader) + before;
}

inline constexpr uint32_t kListedOfThread =
    2;  // so a block takes kSpansOfPiece spans: a chunk that one warp appended, usually of one triangle

// Shared memory of a block.
struct ListedRoom {
  uint32_t sums[kListedOfThread][kChunkWarps], least[kChunkWarps], largest[kChunkWarps];
  unsigned long long at;
};

// Converts listed spans to fragments, unless the spans or the fragments overflowed. A block's spans usually belong to
// one triangle, and contention on its counter dominates, so then the block reserves output with a single atomic.
// Supports programmatic dependent launch.
__global__ void __launch_bounds__(kChunkThreads) EmitListed(const __grid_constant__ FragmentArgs args) {
  constexpr uint32_t kSpans = kChunkThreads * kListedOfThread;
  static_assert(kSpans == kSpansOfPiece);
  __shared__ ListedRoom room;
  AllowNext();
  AwaitEarlier();
  const uint64_t count = args.list.own + *args.list.count;
  if (count > args.list.capacity || AllFragments(args.counts) > args.room) return;
  const uint32_t warp = threadIdx.x / 32;
  for (uint64_t begin = uint64_t(blockIdx.x) * kSpans; begin < count; begin += uint64_t(gridDim.x) * kSpans) {
    uint64_t span[kListedOfThread], at[kListedOfThread];
    uint32_t length[kListedOfThread], before[kListedOfThread], least = ~0u, largest = 0;
#pragma unroll
    for (uint32_t i = 0; i < kListedOfThread; ++i) {
      const uint64_t number = begin + i * kChunkThreads + threadIdx.x;
      span[i] = number < count ? args.list.spans[number] : kNoSpan;
    }
#pragma unroll
    for (uint32_t i = 0; i < kListedOfThread; ++i) {
      length[i] = span[i] == kNoSpan ? 0 : SpanLength(span[i]);
      if (length[i] > 0) {
        least = min(least, SpanTriangle(span[i]));
        largest = max(largest, SpanTriangle(span[i]));
      }
      before[i] = SumUpto(length[i]);
      if (threadIdx.x % 32 == 31) room.sums[i][warp] = before[i];
      before[i] -= length[i];
    }
    least = WarpLeast(least);
    largest = WarpLargest(largest);
    if (threadIdx.x % 32 == 0) room.least[warp] = least, room.largest[warp] = largest;
    __syncthreads();
    for (uint32_t w = 0; w < uint32_t(kChunkWarps); ++w) {
      least = min(least, room.least[w]);
      largest = max(largest, room.largest[w]);
    }
    if (least == largest) {
      uint32_t all = 0;
#pragma unroll
      for (uint32_t i = 0; i < kListedOfThread; ++i) {
        uint32_t of_these;
        before[i] += all + SumOfWarps(room.sums[i], of_these);
        all += of_these;
      }
      if (threadIdx.x == 0) room.at = atomicAdd(reinterpret_cast<unsigned long long*>(args.blocks + least), 0ull + all);
      __syncthreads();
#pragma unroll
      for (uint32_t i = 0; i < kListedOfThread; ++i) at[i] = room.at + before[i];
    } else {
#pragma unroll
      for (uint32_t i = 0; i < kListedOfThread; ++i) at[i] = ReserveByWarps(args, SpanTriangle(span[i]), length[i]);
    }
#pragma unroll
    for (uint32_t i = 0; i < kListedOfThread; ++i) {
      const uint32_t key = length[i] > 0 ? KeyOfBit(args.grid, SpanFirst(span[i])) : 0;
      ForEachVoxel(length[i], [&](int owner, uint32_t x, bool there) {
        const uint32_t of = __shfl_sync(~0u, key, owner) + x, t = __shfl_sync(~0u, SpanTriangle(span[i]), owner);
        const uint64_t to = __shfl_sync(~0u, at[i], owner) + x;
        if (there) args.keys[to] = of, args.values[to] = t;
      });
    }
    __syncthreads();  // the shared memory is free
  }
}

// A row writer that stores fragments at the positions reserved by EmitCells or EmitBundles.
class FragmentWriter {
 public:
  using Args = FragmentArgs;
  static constexpr bool kPartsInRow = false;
  __device__ FragmentWriter(const FragmentArgs& args, uint32_t) : args_(args) {}
  __device__ void Put(uint32_t t, uint32_t row, int x_begin, int x_end) {
    uint64_t at = ReserveByWarps(args_, t, uint32_t(x_end - x_begin));
    const uint32_t key = row * uint32_t(args_.grid.dims[0]);
    for (int x = x_begin; x < x_end; ++x, ++at) {
      args_.keys[at] = key + uint32_t(x);
      args_.values[at] = t;
    }
  }
  __device__ void Finish() {}

 private:
  const FragmentArgs& args_;
};

}  // namespace voxelpipe::cuda
