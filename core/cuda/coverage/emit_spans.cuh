// Rasterizes the triangles deferred by FindCells (coverage_pass.cuh) exactly and lists their rows of voxels as 8-byte
// spans, which later kernels read in any order. Coverage is computed once for all targets, and blending is balanced:
// one thread per span.
//
// Warps append to chunks of the list that they reserve; warps of EmitRest start with a small chunk at the front of the
// list. One reservation per chunk reduces contention on the counter. All lanes of a warp append together. The writer
// decides what is done with rows: it has Args, kPartsInRow, Put and Finish, like SpanWriter. No host-only includes.
#pragma once

#include "cuda/coverage/span_segments.cuh"
#include "cuda/primitives/atomics.cuh"
#include "cuda/primitives/dependent_launch.cuh"
#include "cuda/traversal/shared_setup.cuh"

namespace voxelpipe::cuda {

inline constexpr unsigned kSpansOfPiece = 512;  // chunk of the list that a warp reserves
inline constexpr int kRestBlocks = 4;           // resident blocks of EmitRest per multiprocessor
inline constexpr unsigned kOwnSpans = 32;       // size of the initial chunk of each warp of EmitRest
inline constexpr uint32_t kNoPiece = ~0u;       // the warp has no initial chunk

// The deferred triangles, in layer_queue of `walk`; the largest are moved to large_queue.
struct RestArgs {
  BitArgs walk;
  uint64_t first_triangle = 0, end_triangle = 0;  // the range of triangles to process
  bool repeats = false;                           // large_queue is filled already
};

// The span list.
struct SpanList {
  uint64_t* spans = nullptr;
  uint64_t capacity = 0;      // spans beyond it are counted but not stored
  uint64_t own = 0;           // length of the initial chunks at the front, kOwnSpans per warp of EmitRest; 0: none
  uint64_t* count = nullptr;  // number of entries behind those
};

struct SpanArgs {
  GridView grid;
  SpanList list;
  uint32_t* bits = nullptr;  // bit grid: coverage to set
  // Read a word before the atomic: cheaper if many triangles share a voxel.
  bool look_first = false;
  uint64_t* fragments = nullptr;  // kFragmentSlots counters; null: counted already
  uint32_t first_triangle = 0;    // subtracted from the triangle numbers of spans
};

__device__ inline unsigned long long* Counted(uint64_t* p) {
  return reinterpret_cast<unsigned long long*>(p);
}

__device__ inline void CoverSpan(const SpanArgs& args, uint64_t span) {
  uint32_t* const word = args.bits + SpanWord(span);
  const uint32_t mask = SpanMask(span);
  if (args.look_first && (__ldca(word) & mask) == mask) return;
  if (mask == ~0u) {
    SetAllBits(word);
  } else {
    atomicOr(word, mask);
  }
}

// Row index in the slab's bit grid.
__device__ inline uint32_t BitRow(const GridView& grid, int y, int z) {
  return uint32_t(grid.dims[1]) * uint32_t(z - int(grid.slab_begin)) + uint32_t(y);
}

// Adds the counts of all lanes to one of kFragmentSlots counters. All threads of a warp call it.
__device__ inline void AddFragments(uint64_t* counters, uint64_t count) {
  for (int step = 16; step > 0; step /= 2) count += __shfl_down_sync(~0u, count, step);
  if (threadIdx.x % 32 == 0 && count > 0) atomicAdd(Counted(counters + blockIdx.x % kFragmentSlots), 0ull + count);
}

// Appends to a list from a warp, which reserves one chunk of kPiece entries at a time. All 32 lanes call it together.
template <typename T, unsigned kPiece>
class PieceWriter {
 public:
  // A list of `capacity` entries; `count` counts the entries from `begin` on. `nothing` pads the unused rest of a
  // chunk.
  __device__ PieceWriter(T* list, uint64_t capacity, uint64_t begin, uint64_t* count, T nothing)
      : list_(list), capacity_(capacity), begin_(begin), count_(count), nothing_(nothing) {}

  // Starts with `entries` reserved entries at `at`, within the capacity. Before the first Put.
  __device__ void Begin(uint64_t at, unsigned entries) {
    at_ = list_ + at;
    room_ = entries;
    kept_ = true;
  }

  // Appends one entry for each lane in the mask `lanes`.
  __device__ void Put(uint32_t lanes, T entry) {
    const unsigned lane = threadIdx.x % 32;
    auto total = unsigned(__popc(lanes)), mine = unsigned(__popc(lanes & ((1u << lane) - 1)));
    const bool puts = (lanes >> lane & 1) != 0;
    if (total > room_) {  // fills the current chunk, then opens the next one
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
  uint64_t capacity_, begin_;
  uint64_t* count_;
  T nothing_;
  T* at_ = nullptr;
  unsigned room_ = 0;
  bool kept_ = false;

  __device__ void Open() {
    unsigned long long begin = 0;
    if (threadIdx.x % 32 == 0) begin = atomicAdd(reinterpret_cast<unsigned long long*>(count_), 0ull + kPiece);
    begin = begin_ + __shfl_sync(~0u, begin, 0);
    kept_ = begin + kPiece <= capacity_;
    at_ = list_ + (kept_ ? begin : 0);
    room_ = kPiece;
  }
};

// Appends to the span list. `number`: of the warp in EmitRest; kNoPiece in other kernels.
class SpanListWriter : public PieceWriter<uint64_t, kSpansOfPiece> {
 public:
  __device__ SpanListWriter(const SpanList& list, uint32_t number)
      : PieceWriter(list.spans, list.capacity, list.own, list.count, kNoSpan) {
    if (list.own > 0 && number != kNoPiece) Begin(uint64_t{number} * kOwnSpans, kOwnSpans);
  }
};

// Splits the row of each lane into spans, one word of each row per iteration, since most rows have one: visit(mask of
// lanes with a span, this lane's span).
template <typename Visit>
__device__ inline void ForEachSpan(const GridView& grid, uint32_t t, uint32_t row, int x_begin, int x_end,
                                   Visit&& visit) {
  uint32_t word = row * uint32_t(grid.words_per_row) + uint32_t(x_begin) / 32;
  uint32_t lanes = __ballot_sync(~0u, x_begin < x_end);
  while (lanes != 0) {
    const int end = min(x_end, (x_begin | 31) + 1);
    visit(lanes, PackSpan(word * 32 + uint32_t(x_begin % 32), t, uint32_t(end - x_begin)));
    if (x_begin < x_end) {
      x_begin = end;
      ++word;
    }
    lanes = __ballot_sync(~0u, x_begin < x_end);
  }
}

// A writer that lists spans.
class SpanWriter {
 public:
  using Args = SpanArgs;
  static constexpr bool kPartsInRow = false;  // see PartsOfWarp
  __device__ SpanWriter(const SpanArgs& args, uint32_t number) : args_(args), list_(args.list, number) {}

  // Appends one row of voxels per lane; it may be empty.
  __device__ void Put(uint32_t t, uint32_t row, int x_begin, int x_end) {
    if (x_begin < x_end) fragments_ += uint32_t(x_end - x_begin);
    ForEachSpan(args_.grid, t - args_.first_triangle, row, x_begin, x_end, [&](uint32_t lanes, uint64_t span) {
      list_.Put(lanes, span);
      if ((lanes >> threadIdx.x % 32 & 1) != 0) CoverSpan(args_, span);
    });
  }
  __device__ void Finish() {
    __syncwarp();
    list_.Close();
    if (args_.fragments != nullptr) AddFragments(args_.fragments, fragments_);
  }

 private:
  const SpanArgs& args_;
  SpanListWriter list_;
  uint64_t fragments_ = 0;
};

// Like WalkRest, but limited to fewer registers for more resident blocks, so part of the setup spills. Supports
// programmatic dependent launch.
template <typename Writer>
__global__ void __launch_bounds__(kRestThreads, kRestBlocks)
    EmitRest(const __grid_constant__ RestArgs args, const __grid_constant__ typename Writer::Args out) {
  extern __shared__ double setups[];
  AllowNext();
  AwaitEarlier();
  const BitArgs& walk = args.walk;
  const int lane = int(threadIdx.x % 32), warp_of_block = int(threadIdx.x / 32);
  auto* const shared = reinterpret_cast<SharedSetup*>(setups) + warp_of_block * kSetupsOfWarp;
  const uint64_t count = walk.queued[0];
  const uint64_t warps = uint64_t(gridDim.x) * (kRestThreads / 32);
  const uint64_t each = min(uint64_t{kSetupsOfWarp}, (count + warps - 1) / warps);
  const uint64_t warp = uint64_t(blockIdx.x) * (kRestThreads / 32) + uint64_t(warp_of_block);
  Writer writer(out, uint32_t(warp));
  for (uint64_t begin = warp * each; begin < count; begin += warps * each) {
    const auto number = [&](uint32_t i) {
      const uint32_t t = walk.layer_queue[begin + i];
      return t >= args.first_triangle && t < args.end_triangle ? t : kNoTriangle;
    };
    uint64_t rows = SetUpRowsOfWarp(walk, uint32_t(min(each, count - begin)), number, shared);
    if (rows > kRowsOfWarp) {
      if (!args.repeats) {
        walk.large_queue[atomicAdd(reinterpret_cast<unsigned long long*>(walk.queued + 1), 1ull)] =
            shared[lane].triangle;
      }
      rows = 0;
    }
    // Distributes the rows of all triangles over lanes.
    uint32_t total;
    const uint32_t before = WarpExclusiveSum(uint32_t(rows), total);
    __syncwarp();
    for (uint32_t first = 0; first < total; first += 32) {
      const uint32_t item = first + uint32_t(lane);
      const int i = LaneOfItem<kSetupsOfWarp>(before, item);
      const uint32_t begins = __shfl_sync(~0u, before, i);
      int y = 0, z = 0, x_begin = 0, x_end = 0;
      if (item >= total || !SharedRowSpan(shared[i], item - begins, y, z, x_begin, x_end)) x_begin = x_end = 0;
      writer.Put(shared[i].triangle, BitRow(walk.grid, y, z), x_begin, x_end);
    }
    __syncwarp();
  }
  writer.Finish();
}

inline constexpr int kRowsOfPart = 256;  // rows of a layer per work item of a warp

// Outputs rows [y_begin, y_end) of a layer of a triangle, by a warp. Row-invariant terms are computed once per lane.
template <typename Real, typename Writer>
__device__ inline void PutLayer(const SpanBounds<Real>& bounds, const SharedSetup& s, const GridView& grid, int z,
                                int y_begin, int y_end, Writer& writer) {
  const Layer<Real> layer = SharedLayer(bounds, s, z);
  if (layer.y.empty() || layer.x.empty()) return;
  const double lo = double(y_begin), hi = double(y_end);
  y_begin = int(Clamp(s.base.y + double(layer.y.first), lo, hi));
  y_end = int(Clamp((s.base.y + double(layer.y.last)) + 1, lo, hi));
  for (; y_begin < y_end; y_begin += 32) {
    const int y = y_begin + int(threadIdx.x % 32);
    int x_begin = 0, x_end = 0;
    if (y >= y_end || !RowOfLayer(bounds, layer, s, y, x_begin, x_end)) x_begin = x_end = 0;
    writer.Put(s.triangle, BitRow(grid, y, z), x_begin, x_end);
  }
}

// The work items of one warp out of `all`: first, first + step, ...
struct WarpParts {
  uint32_t first, end, step;
};
// kInRow: contiguous items, usually of one triangle; otherwise interleaved over warps, so that concurrent writes are
// close together.
template <bool kInRow>
__device__ inline WarpParts PartsOfWarp(uint32_t all, uint32_t warp, uint32_t warps) {
  if constexpr (!kInRow) return {warp, all, warps};
  const uint32_t of_warp = (all + warps - 1) / warps, first = min(warp * of_warp, all);
  return {first, min(first + of_warp, all), 1};
}

// Like WalkLarge, but each warp takes parts of layers. Supports programmatic dependent launch.
template <typename Writer>
__global__ void __launch_bounds__(kRestThreads, 6)
    EmitLarge(const __grid_constant__ RestArgs args, const __grid_constant__ typename Writer::Args out) {
  extern __shared__ double setups[];
  __shared__ uint32_t parts_before[kSetupsOfBlock + 1];
  AllowNext();
  AwaitEarlier();
  const BitArgs& walk = args.walk;
  auto* const shared = reinterpret_cast<SharedSetup*>(setups);
  const uint64_t count = walk.queued[kLargeQueue];
  const uint32_t warps = gridDim.x * (kRestThreads / 32), warp = threadIdx.x / 32 * gridDim.x + blockIdx.x;
  const auto parts_of = [](const SharedSetup& s) { return (s.ny + kRowsOfPart - 1) / kRowsOfPart; };
  Writer writer(out, kNoPiece);
  for (uint64_t begin = 0; begin < count; begin += kSetupsOfBlock) {
    const int here = int(min(count - begin, uint64_t{kSetupsOfBlock}));
    static_assert(kSetupsOfBlock == 32 && kRestThreads == kSetupsOfBlock * kBoundsParts);
    {
      const uint32_t place = threadIdx.x / kBoundsParts;
      const uint32_t t = int(place) < here ? walk.large_queue[begin + place] : kNoTriangle;
      const bool wanted = t >= args.first_triangle && t < args.end_triangle;  // kNoTriangle is not
      SharedSetup& s = shared[place];
      const uint64_t rows = SetUpRowsInParts(walk, wanted ? t : kNoTriangle, s);
      if (threadIdx.x % kBoundsParts == 0) {
        parts_before[place] = rows > 0 ? parts_of(s) * LayersOf(s) : 0;
      }
    }
    __syncthreads();
    if (threadIdx.x < 32) {
      uint32_t all;
      const uint32_t before = WarpExclusiveSum(parts_before[threadIdx.x], all);
      parts_before[threadIdx.x] = before;
      if (threadIdx.x == 0) parts_before[kSetupsOfBlock] = all;
    }
    __syncthreads();
    const WarpParts mine = PartsOfWarp<Writer::kPartsInRow>(parts_before[kSetupsOfBlock], warp, warps);
    int i = 0;
    for (uint32_t item = mine.first; item < mine.end; item += mine.step) {
      while (parts_before[i + 1] <= item) ++i;
      const SharedSetup& s = shared[i];
      const uint32_t number = item - parts_before[i], each = parts_of(s), part = number % each;
      const int z = s.begin[2] + int(number / each), y_begin = s.begin[1] + int(part) * kRowsOfPart;
      const int y_end = min(s.end[1], y_begin + kRowsOfPart);
      if (s.span_class == SpanClass::kNarrow) {
        PutLayer(s.narrow, s, walk.grid, z, y_begin, y_end, writer);
      } else if (s.span_class == SpanClass::kWide) {
        PutLayer(s.wide, s, walk.grid, z, y_begin, y_end, writer);
      } else {
        for (int y = y_begin; y < y_end; y += 32) {
          const bool inside = y + int(threadIdx.x % 32) < y_end;
          writer.Put(s.triangle, BitRow(walk.grid, y + int(threadIdx.x % 32), z), inside ? s.begin[0] : 0,
                     inside ? s.end[0] : 0);
        }
      }
    }
    __syncthreads();
  }
  writer.Finish();
}

}  // namespace voxelpipe::cuda
