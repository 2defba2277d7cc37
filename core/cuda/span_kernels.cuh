// The kernels that list the spans of all triangles: who covers which voxels, as records of 8 bytes that further kernels
// take in any order. The walk is done once, whatever is blended then, and blending is balanced: a thread a span.
//
// Three classes share the work, as in walk_kernels.cuh. Warps append spans to pieces of the list that they take one
// after the other; the lanes of a warp always do so together. No host-only includes.
#pragma once

#include "cuda/bit_cells.cuh"
#include "cuda/span_runs.cuh"
#include "cuda/walk_kernels.cuh"

namespace voxelpipe::cuda {

inline constexpr int kEmitThreads = 128, kTrianglesOfEmitBlock = 512;
inline constexpr int kStagedSpans = 2560;       // of a block; what finds no room goes to the list one by one
inline constexpr unsigned kSpansOfPiece = 512;  // what a warp takes of the list at a time

struct SpanArgs {
  WalkArgs walk;  // without its small queue
  uint64_t* spans = nullptr;
  uint64_t capacity = 0;  // spans beyond it are counted and covered, but not kept
  uint64_t first_triangle = 0, end_triangle = 0;
  const Vec3d* world = nullptr;  // positions in world space
  FixedPlace fixed;
  uint64_t* count = nullptr;
  uint32_t* bits = nullptr;       // bit grid: becomes the coverage
  bool look_first = false;        // where many triangles share a voxel: reading a word is cheaper than an atomic
  uint64_t* fragments = nullptr;  // kFragmentSlots counters; null: they are counted already
};

// The next of a counter in shared or global memory: one atomic for all lanes that happen to run together.
template <typename T>
__device__ inline T NextOf(T* counter) {
  const unsigned active = __activemask(), lane = threadIdx.x % 32;
  const int leader = __ffs(int(active)) - 1;
  T at = 0;
  if (int(lane) == leader) at = atomicAdd(counter, T(__popc(active)));
  return __shfl_sync(active, at, leader) + T(__popc(active & ((1u << lane) - 1)));
}

__device__ inline unsigned long long* Counted(uint64_t* p) {
  return reinterpret_cast<unsigned long long*>(p);
}

__device__ inline void CoverSpan(const SpanArgs& args, uint64_t span) {
  uint32_t* const word = args.bits + SpanWord(span);
  const uint32_t mask = SpanMask(span);
  if (args.look_first && (__ldca(word) & mask) == mask) return;
  if (mask == ~0u) {
    *word = mask;
  } else {
    atomicOr(word, mask);
  }
}

// A row of the bit grid, counted over its layers.
__device__ inline uint32_t BitRow(const GridView& grid, int y, int z) {
  return uint32_t(grid.dims[1]) * uint32_t(z - int(grid.slab_begin)) + uint32_t(y);
}

__device__ inline void AddFragments(const SpanArgs& args, uint64_t count) {
  if (args.fragments == nullptr) return;
  for (int step = 16; step > 0; step /= 2) count += __shfl_down_sync(~0u, count, step);
  if (threadIdx.x % 32 == 0 && count > 0) {
    atomicAdd(reinterpret_cast<unsigned long long*>(args.fragments + blockIdx.x % kFragmentSlots), count);
  }
}

// Runs and small triangles; the others wait in the rest's queue. A block takes kTrianglesOfEmitBlock triangles: runs at
// once, and then the small ones that it gathered: those of octants (bit_cells.cuh), and those that are set up. Their
// spans gather in shared memory and go to the list together.
template <bool kThin>
__global__ void __launch_bounds__(kEmitThreads, 7) EmitSpans(const __grid_constant__ SpanArgs args) {
  __shared__ uint64_t staged[kStagedSpans];
  __shared__ uint16_t small[kTrianglesOfEmitBlock];  // octants from the begin on, others from the end on
  __shared__ uint32_t staged_count, octant_count, other_count;
  __shared__ unsigned long long first_of_block;
  const WalkArgs& walk = args.walk;
  if (threadIdx.x == 0) staged_count = octant_count = other_count = 0;
  __syncthreads();
  const unsigned lane = threadIdx.x % 32;
  const auto words_per_row = uint32_t(walk.grid.words_per_row);
  const uint64_t first = args.first_triangle + uint64_t(blockIdx.x) * kTrianglesOfEmitBlock;
  uint64_t fragments = 0;
  const auto keep = [&](uint32_t at, uint64_t span) {
    if (at < kStagedSpans) {
      staged[at] = span;
    } else {
      const uint64_t beyond = NextOf(Counted(args.count));
      if (beyond < args.capacity) args.spans[beyond] = span;
      CoverSpan(args, span);
      fragments += SpanLength(span);
    }
  };
  // The spans of one row. Lanes that run together write theirs one behind the other: so neighbours in a mesh stay
  // neighbours.
  const auto put = [&](uint32_t t, uint32_t row, int x_begin, int x_end) {
    uint32_t word = row * words_per_row + uint32_t(x_begin) / 32;
    do {
      const int end = min(x_end, (x_begin | 31) + 1);
      keep(NextOf(&staged_count), PackSpan(word * 32 + uint32_t(x_begin % 32), t, uint32_t(end - x_begin)));
      x_begin = end;
      ++word;
    } while (x_begin < x_end);
  };
  for (unsigned local = threadIdx.x; local < unsigned(kTrianglesOfEmitBlock); local += kEmitThreads) {
    const uint64_t t = first + local;
    Box32 range{};
    bool rest = false;
    uint32_t rows = 0;
    if (t < args.end_triangle) {
      const CodedBox box = LoadBox(walk.codes, LoadCorners(walk.triangles, t));
      rest = box.far;
      if (!box.far && Clip(box, SlabBox(walk.grid), range)) {
        const int all = range.rows();
        const int size_x = box.last[0] - box.first[0], size_y = box.last[1] - box.first[1],
                  size_z = box.last[2] - box.first[2];
        if (IsRun(box, walk.coverage) && all <= kRowsOfRun) {
          rows = uint32_t(all);
        } else if (all > kRowsOfThread || walk.coverage == Coverage::kCenter) {
          rest = true;
        } else if (args.fixed.bits > 0 && max(size_x, max(size_y, size_z)) <= 1) {
          small[NextOf(&octant_count)] = uint16_t(local);
        } else {
          small[kTrianglesOfEmitBlock - 1 - int(NextOf(&other_count))] = uint16_t(local);
        }
      }
    }
    if (rest) walk.rest_queue[NextOf(Counted(walk.queued))] = uint32_t(t);
    uint32_t row = BitRow(walk.grid, range.begin[1], range.begin[2]);
    const uint32_t step = range.end[2] - range.begin[2] > 1 ? uint32_t(walk.grid.dims[1]) : 1;
    for (; rows > 0; --rows, row += step) put(uint32_t(t), row, range.begin[0], range.end[0]);
    __syncwarp();
  }
  __syncthreads();
  const uint32_t octant_triangles = octant_count, others = other_count;
  for (uint32_t i = threadIdx.x; i - lane < octant_triangles; i += kEmitThreads) {
    uint32_t t = 0, octants = 0;
    FixedBox box{};
    bool doubtful = false;
    if (i < octant_triangles) {
      t = uint32_t(first + small[i]);
      const Corners corners = LoadCorners(walk.triangles, t);
      int v[3][3], corner[3];
      for (int k = 0; k < 3; ++k) {
        const Vec3d& p = args.world[corners.v[k]];
        for (int a = 0; a < 3; ++a) v[k][a] = ToFixed(p[a], args.fixed.scale[a], args.fixed.offset[a]);
      }
      box = BoxOf(v, args.fixed);
      for (int a = 0; a < 3; ++a) corner[a] = (box.first[a] + 1) << args.fixed.bits;
      const Octants o = TouchedOctants<kThin>(v, corner, args.fixed);
      doubtful = box.doubtful || o.doubtful;
      octants = doubtful ? 0 : o.touched;
      const int high[3] = {int(walk.grid.dims[0]), int(walk.grid.dims[1]), int(walk.grid.slab_end)};
      const int low[3] = {0, 0, int(walk.grid.slab_begin)};
      constexpr uint32_t kNear[3] = {0x55, 0x33, 0x0f};
      for (int a = 0; a < 3; ++a) {
        if (box.first[a] == box.last[a] || box.first[a] + 1 >= high[a]) octants &= kNear[a];
        if (box.first[a] < low[a]) octants &= ~kNear[a];
      }
    }
    if (doubtful) walk.rest_queue[NextOf(Counted(walk.queued))] = t;
    __syncwarp();
    // One row after the other, of all lanes.
    uint32_t lanes[4], total = 0;
#pragma unroll
    for (int k = 0; k < 4; ++k) {
      lanes[k] = __ballot_sync(~0u, (octants >> 2 * k & 3) != 0);
      total += uint32_t(__popc(lanes[k]));
    }
    uint32_t at = 0;
    if (lane == 0 && total > 0) at = atomicAdd(&staged_count, total);
    at = __shfl_sync(~0u, at, 0);
    const int x = box.first[0];
#pragma unroll
    for (int k = 0; k < 4; ++k) {
      const uint32_t pair = octants >> 2 * k & 3;
      const uint32_t row = BitRow(walk.grid, box.first[1] + k % 2, box.first[2] + k / 2);
      const bool splits = pair == 3 && (x & 31) == 31;  // between words
      const int x_begin = x + (pair == 2 ? 1 : 0);
      if (pair != 0) {
        const uint32_t word = row * words_per_row + uint32_t(x_begin) / 32;
        keep(at + uint32_t(__popc(lanes[k] & ((1u << lane) - 1))),
             PackSpan(word * 32 + uint32_t(x_begin % 32), t, pair == 3 && !splits ? 2 : 1));
      }
      if (splits) put(t, row, x + 1, x + 2);
      at += uint32_t(__popc(lanes[k]));
    }
    __syncwarp();
  }
  for (uint32_t i = threadIdx.x; i < others; i += kEmitThreads) {
    const auto t = uint32_t(first + small[uint32_t(kTrianglesOfEmitBlock) - 1 - i]);
    const Corners corners = LoadCorners(walk.triangles, t);
    const CodedBox box = LoadBox(walk.codes, corners);
    Box32 range;
    if (!Clip(box, SlabBox(walk.grid), range)) continue;
    SpanBounds<float> bounds;
    if (!SetUpNarrow(walk.positions, walk.coverage, corners, box, bounds)) {
      walk.rest_queue[NextOf(Counted(walk.queued))] = t;
      continue;
    }
    WalkNarrow(bounds, box.base, range,
               [&](int y, int z, int x_begin, int x_end) { put(t, BitRow(walk.grid, y, z), x_begin, x_end); });
  }
  __syncthreads();
  const uint32_t kept = min(staged_count, uint32_t(kStagedSpans));
  if (threadIdx.x == 0) first_of_block = kept == 0 ? 0 : atomicAdd(Counted(args.count), 0ull + kept);
  __syncthreads();
  const uint64_t to = first_of_block;
  for (uint32_t i = threadIdx.x; i - lane < kept; i += kEmitThreads) {
    const uint64_t span = i < kept ? staged[i] : kNoSpan;
    const bool head = FindRun(span).head();
    if (i >= kept) continue;
    if (to + i < args.capacity) args.spans[to + i] = span;
    if (head) CoverSpan(args, span);
    fragments += SpanLength(span);
  }
  __syncwarp();
  AddFragments(args, fragments);
}

// A warp's way to append to a list: it takes a piece of the list after the other. All 32 lanes call it together.
template <typename T, unsigned kPiece>
class PieceWriter {
 public:
  // A list of `capacity` entries that `count` counts; `nothing` fills what is left of a piece.
  __device__ PieceWriter(T* list, uint64_t capacity, uint64_t* count, T nothing)
      : list_(list), capacity_(capacity), count_(count), nothing_(nothing) {}

  // One entry of each lane in `lanes`.
  __device__ void Put(uint32_t lanes, T entry) {
    const unsigned lane = threadIdx.x % 32;
    auto total = unsigned(__popc(lanes)), mine = unsigned(__popc(lanes & ((1u << lane) - 1)));
    const bool puts = (lanes >> lane & 1) != 0;
    if (total > room_) {  // the first of them where there is room, the others in the next piece
      const unsigned here = room_;
      if (puts && mine < here && kept_) at_[mine] = entry;
      Open();
      if (puts && mine >= here && kept_) at_[mine - here] = entry;
      total -= here;
    } else if (puts && kept_) {
      at_[mine] = entry;
    }
    at_ += total;
    room_ -= total;
  }
  __device__ void Close() {
    for (unsigned i = threadIdx.x % 32; i < room_ && kept_; i += 32) at_[i] = nothing_;
    room_ = 0;
  }

 private:
  T* list_;
  uint64_t capacity_;
  uint64_t* count_;
  T nothing_;
  T* at_ = nullptr;
  unsigned room_ = 0;
  bool kept_ = false;

  __device__ void Open() {
    unsigned long long begin = 0;
    if (threadIdx.x % 32 == 0) begin = atomicAdd(reinterpret_cast<unsigned long long*>(count_), 0ull + kPiece);
    begin = __shfl_sync(~0u, begin, 0);
    kept_ = begin + kPiece <= capacity_;
    at_ = list_ + (kept_ ? begin : 0);
    room_ = kPiece;
  }
};

// The same of spans: rows of voxels.
class SpanWriter {
 public:
  __device__ explicit SpanWriter(const SpanArgs& args)
      : args_(args), list_(args.spans, args.capacity, args.count, kNoSpan) {}

  // Voxels of one row of each lane whose row is not empty.
  __device__ void Put(uint32_t t, uint32_t row, int x_begin, int x_end) {
    uint32_t lanes = __ballot_sync(~0u, x_begin < x_end);
    if (lanes == 0) return;
    uint32_t word = row * uint32_t(args_.walk.grid.words_per_row) + uint32_t(x_begin) / 32;
    if (x_begin < x_end) fragments_ += uint32_t(x_end - x_begin);
    // A word of every row at a time: most rows have one.
    do {
      const int end = min(x_end, (x_begin | 31) + 1);
      const uint64_t span = PackSpan(word * 32 + uint32_t(x_begin % 32), t, uint32_t(end - x_begin));
      list_.Put(lanes, span);
      if (x_begin < x_end) {
        CoverSpan(args_, span);
        x_begin = end;
        ++word;
      }
      lanes = __ballot_sync(~0u, x_begin < x_end);
    } while (lanes != 0);
  }
  __device__ void Finish() {
    __syncwarp();
    list_.Close();
    AddFragments(args_, fragments_);
  }

 private:
  const SpanArgs& args_;
  PieceWriter<uint64_t, kSpansOfPiece> list_;
  uint64_t fragments_ = 0;
};

// As WalkRest.
__global__ void __launch_bounds__(kRestThreads, 6) EmitRest(const __grid_constant__ SpanArgs args) {
  extern __shared__ double setups[];
  const WalkArgs& walk = args.walk;
  const int lane = int(threadIdx.x % 32), warp_of_block = int(threadIdx.x / 32);
  auto* const shared = reinterpret_cast<SharedSetup*>(setups) + warp_of_block * kSetupsOfWarp;
  const uint64_t count = walk.queued[0];
  const uint64_t warps = uint64_t(gridDim.x) * (kRestThreads / 32);
  const uint64_t each = min(uint64_t{kSetupsOfWarp}, (count + warps - 1) / warps);
  const uint64_t warp = uint64_t(blockIdx.x) * (kRestThreads / 32) + uint64_t(warp_of_block);
  SpanWriter writer(args);
  for (uint64_t begin = warp * each; begin < count; begin += warps * each) {
    uint64_t rows = 0;
    if (uint64_t(lane) < each && begin + uint64_t(lane) < count) {
      const uint32_t t = walk.rest_queue[begin + uint64_t(lane)];
      rows = SetUpShared(walk.positions, walk.triangles, walk.coverage, walk.grid.SlabRange(), t, shared[lane]);
      if (rows > kRowsOfWarp) {
        walk.large_queue[atomicAdd(reinterpret_cast<unsigned long long*>(walk.queued + 1), 1ull)] = t;
        rows = 0;
      }
    }
    __syncwarp();
    for (int i = 0; i < int(each); ++i) {
      const uint32_t rows_here = __shfl_sync(~0u, uint32_t(rows), i);
      const SharedSetup& s = shared[i];
      for (uint32_t row = 0; row < rows_here; row += 32) {
        int y = 0, z = 0, x_begin = 0, x_end = 0;
        if (row + uint32_t(lane) >= rows_here || !SharedRowSpan(s, row + uint32_t(lane), y, z, x_begin, x_end)) {
          x_begin = x_end = 0;
        }
        writer.Put(s.triangle, BitRow(walk.grid, y, z), x_begin, x_end);
      }
    }
    __syncwarp();
  }
  writer.Finish();
}

// As WalkLarge.
__global__ void __launch_bounds__(kRestThreads, 6) EmitLarge(const __grid_constant__ SpanArgs args) {
  extern __shared__ double setups[];
  __shared__ uint64_t rows_of[kSetupsOfBlock];
  const WalkArgs& walk = args.walk;
  auto* const shared = reinterpret_cast<SharedSetup*>(setups);
  const uint64_t count = walk.queued[1];
  const uint64_t threads = uint64_t(gridDim.x) * kRestThreads, me = uint64_t(blockIdx.x) * kRestThreads + threadIdx.x;
  SpanWriter writer(args);
  for (uint64_t begin = 0; begin < count; begin += kSetupsOfBlock) {
    const int here = int(min(count - begin, uint64_t{kSetupsOfBlock}));
    if (int(threadIdx.x) < here) {
      const uint32_t t = walk.large_queue[begin + threadIdx.x];
      rows_of[threadIdx.x] =
          SetUpShared(walk.positions, walk.triangles, walk.coverage, walk.grid.SlabRange(), t, shared[threadIdx.x]);
    }
    __syncthreads();
    for (int i = 0; i < here; ++i) {
      for (uint64_t row = me - threadIdx.x % 32; row < rows_of[i]; row += threads) {
        int y = 0, z = 0, x_begin = 0, x_end = 0;
        const uint64_t mine = row + threadIdx.x % 32;
        if (mine >= rows_of[i] || !SharedRowSpan(shared[i], uint32_t(mine), y, z, x_begin, x_end)) x_begin = x_end = 0;
        writer.Put(shared[i].triangle, BitRow(walk.grid, y, z), x_begin, x_end);
      }
    }
    __syncthreads();
  }
  writer.Finish();
}

}  // namespace voxelpipe::cuda
