// Plain bits of grids larger than the L2 cache, where triangles are few and large: every word is written once.
//
// An atomic on a word outside of the cache brings its sector from memory, though it has just been cleared. Here the grid is cut into
// pieces, 8x8 rows of so many words, and each triangle is listed with those that its box meets. Then a block takes a piece, draws
// it in shared memory and stores it. A triangle that finds a full list is drawn afterwards by atomics (bit_layers.cuh).
// No host-only includes.
#pragma once

#include "cuda/bit_layers.cuh"
#include "cuda/early_launch.cuh"

namespace voxelpipe::cuda {

inline constexpr int kBinThreads = 64;
inline constexpr int kPieceEdge = 8, kPieceRows = kPieceEdge * kPieceEdge, kPieceWords = 32;
inline constexpr int kPiecePitch = kPieceWords + 4;  // in shared memory: rows begin in different banks, and on 16 bytes
inline constexpr uint32_t kBinRoom = 256;            // triangles of a list
inline constexpr uint32_t kMostLarge = 256;          // that every piece looks at, where there are no lists

// Lists of triangles; or none, and every piece looks at few, which alone are set up: args.largest, or where there are none the first of the large queue,
// up to kMostLarge.
struct Bins {
  uint32_t dims[3] = {0, 0, 0};     // pieces
  uint32_t z_begin = 0, z_end = 0;  // along z, those that are stored: the others lie before or behind the whole mesh
  SharedSetup* set_up = nullptr;    // of every triangle
  uint32_t* counts =
      nullptr;  // of triangles that meet a piece, also those that found no room; in whole units of 16 bytes
  uint32_t* triangles = nullptr;   // kBinRoom a piece
  uint32_t* overflowed = nullptr;  // a bit a triangle; cleared with the counts, behind them
};

// The pieces that a set-up triangle's box meets.
struct PieceBox {
  uint32_t first[3], size[3];
  __device__ uint32_t count() const { return size[0] * size[1] * size[2]; }
};
__device__ inline PieceBox PiecesOf(const SharedSetup& s, int slab_begin) {
  constexpr int kEdges[3] = {kPieceWords * 32, kPieceEdge, kPieceEdge};
  PieceBox box;
  for (int a = 0; a < 3; ++a) {
    const int from = a == 2 ? slab_begin : 0;
    box.first[a] = uint32_t(s.begin[a] - from) / uint32_t(kEdges[a]);
    box.size[a] = uint32_t(s.end[a] - 1 - from) / uint32_t(kEdges[a]) + 1 - box.first[a];
  }
  return box;
}

// Lists a triangle with a piece. Where there is no room the triangle goes to the layer queue, once.
__device__ inline void AddToBin(const BitArgs& args, const Bins& bins, uint32_t piece, uint32_t t) {
  const uint32_t at = atomicAdd(bins.counts + piece, 1u);
  if (at < kBinRoom) {
    bins.triangles[uint64_t{piece} * kBinRoom + at] = t;
    return;
  }
  const uint32_t bit = 1u << (t % 32);
  if ((atomicOr(bins.overflowed + t / 32, bit) & bit) != 0) return;
  args.layer_queue[atomicAdd(reinterpret_cast<unsigned long long*>(args.queued + kLayerQueue), 1ull)] = t;
}

// False where none of the eight layers from z on has a row among the eight from y on. Bounds of y are sums and products of z, each rounded
// once: what lies between two layers has bounds between theirs.
template <typename Real>
__device__ inline bool MayMeet(const SpanBounds<Real>& bounds, Real y, Real z) {
  const Real z_last = z + Real(kPieceEdge - 1);
  Real first = y, last = y + Real(kPieceEdge - 1);
  for (int i = 0; i < 4; ++i) {
    const Real here = bounds.y_of_z[i].s * z, there = bounds.y_of_z[i].s * z_last;
    first = Greater(first, Lesser(bounds.y_of_z[i].lo - here, bounds.y_of_z[i].lo - there));
    last = Lesser(last, Greater(bounds.y_of_z[i].hi - here, bounds.y_of_z[i].hi - there));
  }
  return first <= last;
}
__device__ inline bool MayMeet(const SharedSetup& s, int y, int z) {
  if (s.span_class == SpanClass::kNarrow) return MayMeet(s.narrow, float(y - s.cell[1]), float(z - s.cell[2]));
  if (s.span_class == SpanClass::kWide) return MayMeet(s.wide, double(y) - s.base.y, double(z) - s.base.z);
  return true;
}

// Sets up all triangles and lists them, by warp `warp` of `warps`, which has room for 32. `kFew`: no warp has more than kMostInParts. Waits for
// earlier kernels.
template <bool kFew>
__device__ inline void FillBins(const BitArgs& args, const Bins& bins, uint64_t warp, uint64_t warps,
                                SharedSetup* shared) {
  const unsigned lane = threadIdx.x % 32;
  const uint64_t each = min(uint64_t{32}, (args.triangle_count + warps - 1) / warps);
  for (uint64_t begin = warp * each; begin < args.triangle_count; begin += warps * each) {
    const uint64_t here = min(each, args.triangle_count - begin);
    PieceBox box{};
    uint32_t pieces = 0;
    const auto triangle = [begin](uint32_t i) { return uint32_t(begin) + i; };
    uint64_t rows = 0;
    if constexpr (kFew) {
      rows = SetUpFew(args, uint32_t(here), triangle, shared);
    } else if (lane < here) {
      rows = SetUpRows(args, triangle(lane), shared[lane]);
    }
    if (rows > 0) {
      box = PiecesOf(shared[lane], int(args.grid.slab_begin));
      pieces = box.count();
    }
    uint32_t total;
    const uint32_t before = WarpExclusiveSum(pieces, total);
    __syncwarp();
    AwaitEarlier();
    static_assert(sizeof(SharedSetup) % sizeof(uint2) == 0);
    const auto* const from_here = reinterpret_cast<const uint2*>(shared);
    auto* const to_there = reinterpret_cast<uint2*>(bins.set_up + begin);
    for (uint32_t i = lane; i < uint32_t(here) * uint32_t(sizeof(SharedSetup) / sizeof(uint2)); i += 32) {
      to_there[i] = from_here[i];
    }
    for (uint32_t first = 0; first < total; first += 32) {
      const uint32_t item = first + lane;
      const int i = LaneOfItem(before, item);
      const uint32_t number = item - __shfl_sync(~0u, before, i);
      uint32_t from[3], size[2];
      for (int a = 0; a < 3; ++a) from[a] = __shfl_sync(~0u, box.first[a], i);
      for (int a = 0; a < 2; ++a) size[a] = __shfl_sync(~0u, box.size[a], i);
      if (item >= total) continue;
      const uint32_t yz = number / size[0];
      const uint32_t x = from[0] + number - yz * size[0], y = from[1] + yz % size[1], z = from[2] + yz / size[1];
      if (!MayMeet(shared[i], int(y) * kPieceEdge, int(z) * kPieceEdge + int(args.grid.slab_begin))) continue;
      AddToBin(args, bins, x + bins.dims[0] * (y + bins.dims[1] * z), uint32_t(begin) + uint32_t(i));
    }
    __syncwarp();
  }
  AwaitEarlier();  // also where there was nothing
}

// A layer of a triangle within a piece: its rows, from `begin` to `end` of the piece's eight, and what they share.
struct PieceLayer {
  double x_first, x_last, plane_lo, plane_hi;
  uint32_t triangle;  // of those that the warp draws at once
  uint8_t z, begin, end;
};

inline constexpr uint32_t kDrawnAtOnce = 32 / kPieceEdge;  // triangles of a warp

template <int kThreads>
struct StoreRoom {
  alignas(16) uint32_t words[kPieceRows * kPiecePitch];
  union {
    PieceLayer layers[kThreads];
    uint32_t list[kMostLarge];  // of the piece, where there are no lists
  };
  uint32_t count;
};

// The same, and set-ups of listed triangles, which a warp draws a few of at a time.
template <int kThreads>
struct ListedRoom : StoreRoom<kThreads> {
  alignas(16) SharedSetup setups[kThreads / 32][kDrawnAtOnce];
};
template <bool kListed, int kThreads>
struct StoreRoomType {
  using Type = StoreRoom<kThreads>;
};
template <int kThreads>
struct StoreRoomType<true, kThreads> {
  using Type = ListedRoom<kThreads>;
};
template <bool kListed, int kThreads>
using StoreRoomFor = typename StoreRoomType<kListed, kThreads>::Type;

// False where a set-up triangle does not meet the piece whose first row is y of layer z and whose voxels are [x, x + width).
__device__ inline bool MeetsPiece(const SharedSetup& s, int x, int y, int z, int width) {
  return s.begin[0] < x + width && s.end[0] > x && s.begin[1] < y + kPieceEdge && s.end[1] > y &&
         s.begin[2] < z + kPieceEdge && s.end[2] > z && MayMeet(s, y, z);
}

// Lists those of `large` set-up triangles that may meet the piece whose first row is y of layer z and whose voxels are [x, x + width); how
// many those are. All threads of a block call it.
template <int kThreads>
__device__ inline uint32_t ListLarge(const Bins& bins, uint32_t large, int x, int y, int z, int width,
                                     StoreRoom<kThreads>& room) {
  if (large == 0) return 0;
  if (threadIdx.x == 0) room.count = 0;
  __syncthreads();
  for (uint32_t i = threadIdx.x; i < large; i += kThreads) {
    if (MeetsPiece(bins.set_up[i], x, y, z, width)) room.list[atomicAdd(&room.count, 1u)] = i;
  }
  __syncthreads();
  return room.count;
}

template <typename Real>
__device__ inline Layer<Real> LayerOf(const SpanBounds<Real>& bounds, Real z, PieceLayer& out) {
  const Layer<Real> layer = ComputeLayer(bounds, z);
  out.x_first = double(layer.x.first);
  out.x_last = double(layer.x.last);
  out.plane_lo = double(layer.plane_lo);
  out.plane_hi = double(layer.plane_hi);
  return layer;
}
// In: a layer z of the grid, the piece's first row y. False where the triangle has none of the piece's rows.
__device__ inline bool FindLayer(const SharedSetup& s, int y, int z, PieceLayer& out) {
  if (z < s.begin[2] || z >= s.end[2]) return false;
  int begin = s.begin[1], end = s.end[1];
  if (s.span_class == SpanClass::kNarrow) {
    const Layer<float> layer = LayerOf(s.narrow, float(z - s.cell[2]), out);
    if (layer.y.empty() || layer.x.empty()) return false;
    begin = max(begin, s.cell[1] + int(layer.y.first));
    end = min(end, s.cell[1] + int(layer.y.last) + 1);
  } else if (s.span_class == SpanClass::kWide) {
    const Layer<double> layer = LayerOf(s.wide, double(z) - s.base.z, out);
    if (layer.y.empty() || layer.x.empty()) return false;
    const double lo = double(begin), hi = double(end);
    begin = int(Clamp(s.base.y + double(layer.y.first), lo, hi));
    end = int(Clamp((s.base.y + double(layer.y.last)) + 1, lo, hi));
  }
  begin = max(begin - y, 0);
  end = min(end - y, kPieceEdge);
  if (begin >= end) return false;
  out.begin = uint8_t(begin);
  out.end = uint8_t(end);
  return true;
}

template <typename Real>
__device__ inline Interval<Real> RowOf(const SpanBounds<Real>& bounds, const PieceLayer& l, Real y) {
  Layer<Real> layer;
  layer.x = {Real(l.x_first), Real(l.x_last)};
  layer.plane_lo = Real(l.plane_lo);
  layer.plane_hi = Real(l.plane_hi);
  return ComputeRow(bounds, layer, y);
}
// Row y of the grid of a layer that has it. False if the triangle does not touch it.
__device__ inline bool FindRow(const SharedSetup& s, const PieceLayer& layer, int y, int& x_begin, int& x_end) {
  x_begin = s.begin[0];
  x_end = s.end[0];
  if (s.span_class == SpanClass::kNarrow) {
    const Interval<float> row = RowOf(s.narrow, layer, float(y - s.cell[1]));
    if (row.empty()) return false;
    x_begin = max(x_begin, s.cell[0] + int(row.first));
    x_end = min(x_end, s.cell[0] + int(row.last) + 1);
  } else if (s.span_class == SpanClass::kWide) {
    const Interval<double> row = RowOf(s.wide, layer, double(y) - s.base.y);
    if (row.empty()) return false;
    const double lo = double(x_begin), hi = double(x_end);
    x_begin = int(Clamp(s.base.x + double(row.first), lo, hi));
    x_end = int(Clamp((s.base.x + double(row.last)) + 1, lo, hi));
  }
  return x_begin < x_end;
}

// Sets voxels [x_begin, x_end) of a row in shared memory.
__device__ inline void SetSharedRow(uint32_t* row, int x_begin, int x_end) {
  const int last = (x_end - 1) / 32;
  uint32_t mask = ~0u << (x_begin % 32);
  for (int w = x_begin / 32; w < last; ++w) {
    atomicOr(row + w, mask);
    mask = ~0u;
  }
  atomicOr(row + last, mask & ~0u >> (31 - (x_end - 1) % 32));
}

// Brings set-ups of a warp's next triangles to shared memory, each by the eight lanes whose `t` it is; none of kNoTriangle. All that they need is asked for
// at once: where it lies it would be waited for field by field. All threads of the warp call it.
__device__ inline void FetchSetups(const Bins& bins, uint32_t t, SharedSetup* setups) {
  static_assert(sizeof(SharedSetup) % sizeof(uint4) == 0);
  constexpr uint32_t kQuads = sizeof(SharedSetup) / sizeof(uint4);
  const uint32_t lane = threadIdx.x % 32;
  if (t != kNoTriangle) {
    const auto* const from = reinterpret_cast<const uint4*>(bins.set_up + t);
    auto* const to = reinterpret_cast<uint4*>(setups + lane / kPieceEdge);
    uint4 quads[(kQuads + kPieceEdge - 1) / kPieceEdge];
#pragma unroll
    for (uint32_t i = 0; i * kPieceEdge < kQuads; ++i) {
      const uint32_t at = i * kPieceEdge + lane % kPieceEdge;
      if (at < kQuads) quads[i] = __ldg(from + at);
    }
#pragma unroll
    for (uint32_t i = 0; i * kPieceEdge < kQuads; ++i) {
      const uint32_t at = i * kPieceEdge + lane % kPieceEdge;
      if (at < kQuads) to[at] = quads[i];
    }
  }
  __syncwarp();
}

// Draws the first `count` triangles of a list into the room's words, row (y, z) of the piece at kPiecePitch * (y + 8*z). In: the grid's row
// and layer where the piece begins, its first voxel and how many there are. Warps take four triangles at a time; all threads of
// the block call it, and a barrier is to follow.
template <int kThreads>
__device__ inline void DrawPiece(const Bins& bins, const uint32_t* triangles, uint32_t count, int x, int y, int z,
                                 int width, ListedRoom<kThreads>& room) {
  const unsigned lane = threadIdx.x % 32;
  PieceLayer* const layers = room.layers + threadIdx.x / 32 * 32;
  SharedSetup* const setups = room.setups[threadIdx.x / 32];
  const auto quads = reinterpret_cast<uint4*>(room.words);
  for (int i = int(threadIdx.x); i < kPieceRows * kPiecePitch / 4; i += kThreads) quads[i] = uint4{0, 0, 0, 0};
  __syncthreads();
  for (uint32_t first = threadIdx.x / 32 * kDrawnAtOnce; first < count; first += kThreads / kPieceEdge) {
    const uint32_t number = first + lane / kPieceEdge;
    uint32_t rows = 0;
    FetchSetups(bins, number < count ? triangles[number] : kNoTriangle, setups);
    if (number < count) {
      PieceLayer layer;
      layer.triangle = lane / kPieceEdge;
      layer.z = uint8_t(lane % kPieceEdge);
      if (FindLayer(setups[layer.triangle], y, z + int(layer.z), layer)) {
        rows = uint32_t(layer.end) - layer.begin;
        layers[lane] = layer;
      }
    }
    uint32_t total;
    const uint32_t before = WarpExclusiveSum(rows, total);
    __syncwarp();
    for (uint32_t begins = 0; begins < total; begins += 32) {
      const uint32_t item = begins + lane;
      const int i = LaneOfItem(before, item);
      const uint32_t row_of_layer = item - __shfl_sync(~0u, before, i);
      if (item >= total) continue;
      const PieceLayer& layer = layers[i];
      const int row = int(layer.begin) + int(row_of_layer);
      int x_begin, x_end;
      if (!FindRow(setups[layer.triangle], layer, y + row, x_begin, x_end)) continue;
      x_begin = max(x_begin - x, 0);
      x_end = min(x_end - x, width);
      if (x_begin < x_end) {
        SetSharedRow(room.words + (int(layer.z) * kPieceEdge + row) * kPiecePitch, x_begin, x_end);
      }
    }
    __syncwarp();
  }
}

template <typename Real>
__device__ inline SpanBounds<Real> BoundsOfRows(const SpanBounds<Real>& bounds) {
  SpanBounds<Real> rows;
  for (int i = 0; i < 3; ++i) rows.x_of_y[i] = bounds.x_of_y[i];
  rows.plane_sy = bounds.plane_sy;
  return rows;
}

// Whether the plane alone tells the voxels of the layer's rows. Bounds of x are a product and a sum, each rounded once: what lies between two rows
// has bounds between theirs.
__device__ inline bool IsPlaneAlone(const SharedSetup& s, const PieceLayer& layer, int y) {
  if (s.span_class != SpanClass::kWide || double(s.cell[0]) != s.base.x) return false;
  const double first = double(y + int(layer.begin)) - s.base.y, last = double(y + int(layer.end) - 1) - s.base.y;
  double lo = layer.x_first, hi = layer.x_last;
  for (int i = 0; i < 3; ++i) {
    const Bound<double>& bound = s.wide.x_of_y[i];
    const double here = bound.s * first, there = bound.s * last;
    lo = Greater(lo, Greater(bound.lo - here, bound.lo - there));
    hi = Lesser(hi, Lesser(bound.hi - here, bound.hi - there));
  }
  const double here = s.wide.plane_sy * first, there = s.wide.plane_sy * last;
  return lo <= Lesser(layer.plane_lo - here, layer.plane_lo - there) &&
         hi >= Greater(layer.plane_hi - here, layer.plane_hi - there);
}

// Rounded up and down; what 32 bits do not hold becomes the nearest that they do.
__device__ inline int IntAbove(double v) {
#if defined(__CUDA_ARCH__)
  return __double2int_ru(v);
#else
  return int(Clamp(ceil(v), -0x1p31, 0x1p31 - 1));
#endif
}
__device__ inline int IntBelow(double v) {
#if defined(__CUDA_ARCH__)
  return __double2int_rd(v);
#else
  return int(Clamp(floor(v), -0x1p31, 0x1p31 - 1));
#endif
}

// The rows of a layer of which IsPlaneAlone: set(row of the piece, x_begin, x_end).
template <typename Set>
__device__ inline void ForEachRowOfPlane(const SharedSetup& s, const PieceLayer& layer, int y, Set&& set) {
  const int cell = s.cell[0], least = s.begin[0] - cell, most = s.end[0] - cell;
  const double slope = s.wide.plane_sy;
  double local = double(y + int(layer.begin)) - s.base.y;
  for (int row = int(layer.begin); row < int(layer.end); ++row, local += 1) {
    const double shift = slope * local;
    const int first = IntAbove(layer.plane_lo - shift), last = IntBelow(layer.plane_hi - shift);
    set(row, cell + min(max(first, least), most), cell + min(max(last, least - 1), most - 1) + 1);
  }
}

// The rows of a layer, as FindRow has them; likewise.
template <typename Set>
__device__ inline void ForEachRowOf(const SharedSetup& s, const PieceLayer& layer, int y, Set&& set) {
  const int x_lo = s.begin[0], x_hi = s.end[0];
  if (s.span_class == SpanClass::kNarrow) {
    const SpanBounds<float> bounds = BoundsOfRows(s.narrow);
    const int from_x = s.cell[0], from_y = s.cell[1];
    for (int row = int(layer.begin); row < int(layer.end); ++row) {
      const Interval<float> x = RowOf(bounds, layer, float(y + row - from_y));
      if (!x.empty()) set(row, max(x_lo, from_x + int(x.first)), min(x_hi, from_x + int(x.last) + 1));
    }
  } else if (s.span_class == SpanClass::kWide) {
    const SpanBounds<double> bounds = BoundsOfRows(s.wide);
    const double from_x = s.base.x, from_y = s.base.y, lo = double(x_lo), hi = double(x_hi);
    for (int row = int(layer.begin); row < int(layer.end); ++row) {
      const Interval<double> x = RowOf(bounds, layer, double(y + row) - from_y);
      if (!x.empty()) set(row, int(Clamp(from_x + x.first, lo, hi)), int(Clamp((from_x + x.last) + 1, lo, hi)));
    }
  } else {
    for (int row = int(layer.begin); row < int(layer.end); ++row) set(row, x_lo, x_hi);
  }
}

// DrawPiece for triangles that fill most of it: a thread takes a layer. Most often no edge is near, and the plane alone tells the rows.
template <int kThreads>
__device__ inline void DrawLayers(const Bins& bins, const uint32_t* triangles, uint32_t count, int x, int y, int z,
                                  int width, StoreRoom<kThreads>& room) {
  const auto quads = reinterpret_cast<uint4*>(room.words);
  for (int i = int(threadIdx.x); i < kPieceRows * kPiecePitch / 4; i += kThreads) quads[i] = uint4{0, 0, 0, 0};
  __syncthreads();
  const uint32_t lane = threadIdx.x % 32, total = count * kPieceEdge;
  for (uint32_t begins = threadIdx.x - lane; begins < total; begins += kThreads) {
    const uint32_t item = min(begins + lane, total - 1);
    const SharedSetup& s = bins.set_up[triangles[item / kPieceEdge]];
    const int of_piece = int(item % kPieceEdge);
    PieceLayer layer;
    const bool has = begins + lane < total && FindLayer(s, y, z + of_piece, layer);
    // Where some lane needs edges, too, all take that way: they would wait for it.
    const bool plane_alone = __all_sync(~0u, !has || IsPlaneAlone(s, layer, y)) != 0;
    const auto set = [&](int row, int x_begin, int x_end) {
      x_begin = max(x_begin - x, 0);
      x_end = min(x_end - x, width);
      if (x_begin < x_end) SetSharedRow(room.words + (of_piece * kPieceEdge + row) * kPiecePitch, x_begin, x_end);
    };
    if (has && plane_alone) {
      ForEachRowOfPlane(s, layer, y, set);
    } else if (has) {
      ForEachRowOf(s, layer, y, set);
    }
    __syncwarp();
  }
}

// Writes piece (x, y, z) of the grid. `kQuads`: rows are whole units of 16 bytes; `kListed`: there are lists, or else `large` set-up triangles.
// All threads of a block call it.
template <bool kQuads, bool kListed, int kThreads>
__device__ inline void StorePiece(const BitArgs& args, const Bins& bins, uint32_t large, uint32_t x, uint32_t y,
                                  uint32_t z, StoreRoomFor<kListed, kThreads>& room) {
  constexpr int kEach = kQuads ? 4 : 1, kUnits = kPieceWords / kEach;  // side by side along a row
  constexpr int kRowStep = kThreads / kUnits;
  const auto me = int(threadIdx.x);
  const auto words_per_row = int(args.grid.words_per_row), ny = int(args.grid.dims[1]);
  const int z_begin = int(args.grid.slab_begin),
            layers = min(int(args.grid.slab_end) - z_begin - int(z) * kPieceEdge, kPieceEdge);
  const int first_y = int(y) * kPieceEdge, first_z = int(z) * kPieceEdge, first_word = int(x) * kPieceWords;
  const int words = min(kPieceWords, words_per_row - first_word);
  const uint32_t* triangles = room.list;
  uint32_t count;
  if constexpr (!kListed) {
    count = ListLarge(bins, large, first_word * 32, first_y, first_z + z_begin, words * 32, room);
  } else {
    const uint32_t piece = x + bins.dims[0] * (y + bins.dims[1] * z);
    triangles = bins.triangles + uint64_t{piece} * kBinRoom;
    count = min(__ldg(bins.counts + piece), kBinRoom);
  }
  if (count > 0) {
    if constexpr (kListed) {
      DrawPiece(bins, triangles, count, first_word * 32, first_y, first_z + z_begin, words * 32, room);
    } else {
      DrawLayers(bins, triangles, count, first_word * 32, first_y, first_z + z_begin, words * 32, room);
    }
    __syncthreads();
  }
  const int unit = me % kUnits * kEach, first_row = me / kUnits;
  if (unit >= words) return;
  const auto at = [&](int row_y, int row_z) {
    return args.bits +
           (uint64_t(uint32_t(ny)) * uint32_t(first_z + row_z) + uint32_t(first_y + row_y)) * uint32_t(words_per_row) +
           uint32_t(first_word + unit);
  };
  const uint32_t* drawn = room.words + first_row * kPiecePitch + unit;
  if constexpr (kQuads) {
    static_assert(kRowStep % kPieceEdge == 0);  // whole layers at a time
    constexpr int kLayerStep = kRowStep / kPieceEdge;
    const int row_y = first_row % kPieceEdge, first_layer = first_row / kPieceEdge;
    if (first_y + row_y >= ny) return;
    auto* to = reinterpret_cast<uint4*>(at(row_y, first_layer));
    const uint64_t step = uint64_t(uint32_t(ny)) * uint32_t(words_per_row / 4) * kLayerStep;
    if (count == 0) {
      for (int i = first_layer; i < layers; i += kLayerStep, to += step) *to = uint4{0, 0, 0, 0};
    } else {
      for (int i = first_layer; i < layers; i += kLayerStep, to += step, drawn += kRowStep * kPiecePitch) {
        *to = *reinterpret_cast<const uint4*>(drawn);
      }
    }
  } else {
    for (int row = first_row; row < layers * kPieceEdge; row += kRowStep, drawn += kRowStep * kPiecePitch) {
      if (first_y + row % kPieceEdge < ny) *at(row % kPieceEdge, row / kPieceEdge) = count > 0 ? *drawn : 0;
    }
  }
}

// Clears what stands behind the last word up to a whole unit of 16 bytes, by a block.
__device__ inline void ClearBehind(const BitArgs& args) {
  const uint64_t begin = uint64_t(args.grid.words_per_row) * uint64_t(args.grid.dims[1]) *
                             uint64_t(args.grid.slab_end - args.grid.slab_begin) +
                         threadIdx.x;
  if (begin < args.quads * 4) args.bits[begin] = 0;
}

// The same of all pieces along z that are stored; and zeros behind the last word of all, up to a whole unit.
template <bool kQuads, bool kListed, int kThreads>
__device__ inline void StorePieces(const BitArgs& args, const Bins& bins, StoreRoomFor<kListed, kThreads>& room) {
  if (!kQuads && blockIdx.x == 0 && blockIdx.y == 0 && blockIdx.z == 0) ClearBehind(args);
  uint32_t large = 0;
  if constexpr (!kListed) {
    large = args.largest != nullptr ? args.largest->listed()
                                    : uint32_t(min(__ldg(args.queued + kLargeQueue), uint64_t{kMostLarge}));
  }
  for (uint32_t z = bins.z_begin + blockIdx.z; z < bins.z_end; z += gridDim.z) {
    if (z != bins.z_begin + blockIdx.z) __syncthreads();  // the room is free again
    StorePiece<kQuads, kListed, kThreads>(args, bins, large, blockIdx.x, blockIdx.y, z, room);
  }
}

}  // namespace voxelpipe::cuda
