// The A-buffer's fragments of a mesh's few largest triangles (scattered.h), in the order in which all are sorted in the end: by voxel, and of one voxel
// by triangle. A lane takes a row of voxels, of which each triangle has an interval, and sorts what few fragments there are; where they are many,
// where one stands in its row is counted from the intervals' ends. No host-only includes.
#pragma once

#include "cuda/apart_views.h"
#include "cuda/bit_setups.cuh"
#include "cuda/look_back.cuh"
#include "cuda/piece_layers.cuh"
#include "cuda/span_kernels.cuh"

namespace voxelpipe::cuda {

inline constexpr int kApartThreads = 128, kApartBlocks = 12;
inline constexpr uint32_t kApartWarps = kApartThreads / 32;
inline constexpr uint32_t kApartRows = 32;                         // of a layer, that a warp takes: a lane each
inline constexpr uint32_t kApartGroup = kApartRows * kApartWarps;  // that a block takes at once

// Sets up the largest triangles, in the order of their ids; those that are not drawn apart in this grid get no layers. Clears what ListApart wants
// cleared.
__global__ void __launch_bounds__(32)
    SetUpListed(const __grid_constant__ BitArgs walk, const __grid_constant__ ApartArgs args) {
  for (uint64_t i = blockIdx.x * 32 + threadIdx.x; i < args.groups; i += gridDim.x * 32) args.before[i] = 0;
  if (blockIdx.x == 0 && threadIdx.x == 0) *args.taken = 0;
  const LargestTriangles& largest = *walk.largest;
  const uint32_t listed = largest.listed(), part = threadIdx.x % kBoundsParts;
  const uint32_t place = blockIdx.x * kMostInParts + threadIdx.x / kBoundsParts;
  const bool has = place < listed;
  const uint32_t t = has ? largest.triangles[place] : 0;
  uint32_t number = 0;  // among them
  for (uint32_t i = 0; i < listed; ++i) number += largest.triangles[i] < t ? 1 : 0;
  Vec3d mine{};
  if (has && part < 3) mine = PlacePosition(walk, largest.corners[place][part]);
  __syncwarp();
  SharedSetup& s = args.setups[has ? number : 0];
  const uint64_t rows = SetUpPlacedInParts(walk, has, t, mine, s);
  if (has && rows <= kRowsOfWarp && part == 0) s.begin[2] = s.end[2] = 0;
}

// A triangle's layer: its rows of a group, from y_begin to y_end of the grid, and what they share.
struct ApartLayer {
  PieceLayer layer;
  double slope, base_y;  // where the plane alone tells the rows
  RowClip clip;
  int y_begin, y_end;
  bool plane_alone;
};

// The layer z of a set-up, from row y on.
__device__ inline void FindApartLayer(const SharedSetup& s, int y, int z, ApartLayer& out) {
  out.y_begin = out.y_end = 0;
  if (!FindLayer(s, y, z, out.layer, int(kApartGroup))) return;
  out.y_begin = y + int(out.layer.begin);
  out.y_end = y + int(out.layer.end);
  out.plane_alone = IsPlaneAlone(s, out.layer, y);
  if (!out.plane_alone) return;
  out.slope = s.wide.plane_sy;
  out.base_y = s.base.y;
  out.clip = RowClip(s);
}

// Voxels [begin, end) of a row.
struct ApartSpan {
  uint32_t packed = 0;

  __device__ ApartSpan() = default;
  __device__ explicit ApartSpan(uint32_t p) : packed(p) {}
  __device__ ApartSpan(int begin, int end) : packed(uint32_t(begin) | uint32_t(end) << 16) {}
  __device__ int begin() const { return int(packed & 0xffff); }
  __device__ int end() const { return int(packed >> 16); }
  __device__ int length() const { return end() - begin(); }
};

// Fragments of a row that a lane sorts. A warp one of whose rows has more goes by spans.
inline constexpr uint32_t kSortedApart = 32;

// A fragment within its row, in 16 bits: those of lesser voxels are less, and of one voxel those of spans of lesser numbers.
inline constexpr uint32_t kApartNumberBits = 5, kMostApartRow = 1 << (16 - kApartNumberBits);
static_assert(kMostApart < 1 << kApartNumberBits);  // all ones is none
__device__ inline uint32_t ApartCode(uint32_t x, uint32_t number) {
  return x << kApartNumberBits | number;
}

// Of a warp.
struct ApartRows {
  union {
    alignas(4) uint16_t found[kSortedApart / 2][kApartRows][2];  // codes of each row, in no order
    uint32_t staged[kSortedApart * kApartRows];  // codes of all, in their order; in the upper half the row
    uint32_t spans[kMostApart][kApartRows];
  };
  uint32_t ids[kMostApart];  // of spans: their triangles
};

// Calls take(number, x_begin, x_end) for the spans, empty or not, that the triangles in `drawing` have in the lane's row, `y` of the grid, numbered in
// the order of their ids. All lanes of a warp call it.
template <typename Take>
__device__ inline void ForEachApartSpan(const SharedSetup* setups, const ApartLayer* layers, uint32_t drawing, int y,
                                        Take&& take) {
  uint32_t number = 0;
  for (uint32_t left = drawing; left != 0; left &= left - 1, ++number) {
    const int i = __ffs(int(left)) - 1;
    const ApartLayer& l = layers[i];
    const bool inside = y >= l.y_begin && y < l.y_end;
    int x_begin = 0, x_end = 0;
    if (l.plane_alone) {
      RowOfPlane(l.clip, l.layer, l.slope * (double(y) - l.base_y), x_begin, x_end);
    } else if (inside && !FindRow(setups[i], l.layer, y, x_begin, x_end)) {
      x_begin = x_end = 0;
    }
    if (!inside || x_begin >= x_end) x_begin = x_end = 0;
    take(number, x_begin, x_end);
  }
}

// Both halves of v[i] and of v[j], i before j, in order.
__device__ inline void OrderHalves(uint32_t& v, uint32_t& w) {
  const uint32_t least = __vminu2(v, w);
  w = __vmaxu2(v, w);
  v = least;
}

// Sorts 2 * kCount numbers of 16 bits, two to an element, all lanes of a warp alike: the lower halves become the least of them, in order, the upper
// ones the others. At first both halves by themselves (K. E. Batcher, "Sorting networks and their applications", AFIPS 1968: odd-even merging), then
// each with the other's reverse, which leaves two bitonic sequences.
template <int kCount>
__device__ inline void SortInLane(uint32_t (&v)[kCount]) {
#pragma unroll
  for (int size = 1; size < kCount; size *= 2) {
#pragma unroll
    for (int step = size; step > 0; step /= 2) {
#pragma unroll
      for (int i = 0; i < kCount; ++i) {
        const int j = i + step;
        if (i >= step % size && (i - step % size) / step % 2 == 0 && j < kCount && i / (2 * size) == j / (2 * size)) {
          OrderHalves(v[i], v[j]);
        }
      }
    }
  }
#pragma unroll
  for (int i = 0; i < kCount / 2; ++i) {
    const uint32_t mine = v[i], other = __byte_perm(v[kCount - 1 - i], 0, 0x1032);
    const uint32_t least = __vminu2(mine, other), largest = __vmaxu2(mine, other);
    v[i] = __byte_perm(least, largest, 0x5410);
    v[kCount - 1 - i] = __byte_perm(least, largest, 0x7632);
  }
#pragma unroll
  for (int step = kCount / 2; step > 0; step /= 2) {
#pragma unroll
    for (int i = 0; i < kCount; ++i) {
      if ((i & step) == 0) OrderHalves(v[i], v[i + step]);
    }
  }
}

// Sorts the fragments that were found, `count` in the lane's row, at most 2 * kCount, and stages them from number `at` on. All lanes of a warp call it.
template <int kCount>
__device__ inline void StageSorted(ApartRows& rows, uint32_t count, uint32_t at) {
  const unsigned lane = threadIdx.x % 32;
  uint32_t codes[kCount];
#pragma unroll
  for (uint32_t i = 0; i < uint32_t(kCount); ++i) {
    uint32_t both;
    memcpy(&both, rows.found[i][lane], sizeof(both));
    if (2 * i + 1 >= count) both |= 0xffff0000;
    codes[i] = 2 * i < count ? both : ~0u;
  }
  __syncwarp();
  SortInLane(codes);
#pragma unroll
  for (uint32_t i = 0; i < 2 * uint32_t(kCount); ++i) {
    if (i < count) rows.staged[at + i] = __byte_perm(codes[i % kCount], lane, i < uint32_t(kCount) ? 0x5410 : 0x5432);
  }
  __syncwarp();
}

// How many fragments of a row stand before voxel x of span `number` of `count`.
__device__ inline uint32_t PlaceInRow(const ApartRows& rows, uint32_t count, uint32_t row, uint32_t number, int x) {
  int before = 0;
  for (uint32_t i = 0; i < count; ++i) {
    const ApartSpan other(rows.spans[i][row]);
    before += min(max(x + (i < number ? 1 : 0) - other.begin(), 0), other.length());
  }
  return uint32_t(before);
}

struct ApartRoom {
  ApartLayer layers[kMostApart];
  ApartRows rows[kApartWarps];
  uint32_t sums[kApartWarps];
  uint32_t group;
  uint64_t before;
};

// The fragments of a group of rows of a layer, which begin where those of all groups before it end.
__device__ inline void ListApartGroup(const ApartArgs& args, uint32_t group, ApartRoom& room) {
  const uint32_t lane = threadIdx.x % 32, warp = threadIdx.x / 32;
  const auto ny = uint32_t(args.grid.dims[1]), nx = uint32_t(args.grid.dims[0]);
  const uint32_t along_y = (ny + kApartGroup - 1) / kApartGroup, z = group / along_y;
  const uint32_t y = (group - z * along_y) * kApartGroup, first_row = y + warp * kApartRows;
  const uint32_t listed = args.largest->listed();
  if (warp == 0 && lane < listed) {
    FindApartLayer(args.setups[lane], int(y), int(args.grid.slab_begin) + int(z), room.layers[lane]);
  }
  __syncthreads();
  ApartRows& rows = room.rows[warp];
  const bool draws = lane < listed && room.layers[lane].y_begin < int(first_row + kApartRows) &&
                     room.layers[lane].y_end > int(first_row);
  const uint32_t drawing = __ballot_sync(~0u, draws), count = uint32_t(__popc(drawing));
  if (draws) rows.ids[__popc(drawing & ((1u << lane) - 1))] = args.setups[lane].triangle;
  uint32_t mine = 0;
  ForEachApartSpan(
      args.setups, room.layers, drawing, int(first_row + lane), [&](uint32_t number, int x_begin, int x_end) {
        const auto length = uint32_t(x_end - x_begin), kept = min(length, kSortedApart - min(mine, kSortedApart));
        for (uint32_t i = mine; i < mine + kept; ++i) {
          rows.found[i / 2][lane][i % 2] = uint16_t(ApartCode(uint32_t(x_begin) + i - mine, number));
        }
        mine += length;
      });
  uint32_t total, all;
  const uint32_t before_row = WarpExclusiveSum(mine, total);
  if (lane == 0) room.sums[warp] = total;
  __syncthreads();
  const uint32_t before_warp = SumOfWarps(room.sums, all), first_key = (z * ny + first_row) * nx;
  if (warp == 0) SayHere(args.before, all, group);
  const uint32_t most = WarpLargest(mine);
  if (most <= kSortedApart / 2) {
    StageSorted<kSortedApart / 4>(rows, mine, before_row);
  } else if (most <= kSortedApart) {
    StageSorted<kSortedApart / 2>(rows, mine, before_row);
  }
  if (warp == 0) {  // those before have come as far by now
    const uint64_t sum = LookBack(args.before, all, group);
    if (lane == 0) room.before = sum;
  }
  __syncthreads();
  if (group + 1 == args.groups && threadIdx.x == 0) *args.total = room.before + all;
  const uint64_t out = room.before + before_warp;
  if (total == 0 || out + total > args.room) return;
  uint32_t *const keys = args.keys + out, *const triangles = args.triangles + out;
  if (most <= kSortedApart) {
#pragma unroll 2
    for (uint32_t i = lane; i < total; i += 32) {
      const uint32_t code = rows.staged[i];
      keys[i] = first_key + (code >> 16) * nx + (code >> kApartNumberBits & (kMostApartRow - 1));
      triangles[i] = rows.ids[code & ((1u << kApartNumberBits) - 1)];
    }
    return;
  }
  ForEachApartSpan(
      args.setups, room.layers, drawing, int(first_row + lane),
      [&](uint32_t number, int x_begin, int x_end) { rows.spans[number][lane] = ApartSpan(x_begin, x_end).packed; });
  __syncwarp();
  for (uint32_t row = 0; row < kApartRows; ++row) {
    const uint32_t to = __shfl_sync(~0u, before_row, int(row));
    const ApartSpan span(lane < count ? rows.spans[lane][row] : 0);
    ForEachVoxel(uint32_t(span.length()), [&](int owner, uint32_t in_span, bool there) {
      const int x = __shfl_sync(~0u, span.begin(), owner) + int(in_span);
      if (!there) return;
      const uint32_t at = to + PlaceInRow(rows, count, row, uint32_t(owner), x);
      keys[at] = first_key + row * nx + uint32_t(x);
      triangles[at] = rows.ids[owner];
    });
  }
}

// The fragments of all rows, in their order, as far as there is room, and how many there are. Blocks take groups of rows in their order, and there may be
// few blocks.
__global__ void __launch_bounds__(kApartThreads, kApartBlocks) ListApart(const __grid_constant__ ApartArgs args) {
  __shared__ ApartRoom room;
  for (;;) {
    if (threadIdx.x == 0) room.group = atomicAdd(args.taken, 1u);
    __syncthreads();
    const uint32_t group = room.group;
    if (group >= args.groups) return;
    ListApartGroup(args, group, room);
    __syncthreads();
  }
}

}  // namespace voxelpipe::cuda
