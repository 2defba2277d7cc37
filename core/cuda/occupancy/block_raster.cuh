// Occupancy bits block by block: a thread block rasterizes the triangles that intersect a block of the grid ("piece" in
// the code) in shared memory and stores it, so that every word of the grid is written once. The triangles come from
// bins (block_bins.cuh), or are a few that every grid block tests. No host-only includes.
#pragma once

#include "cuda/occupancy/block_bins.cuh"

namespace voxelpipe::cuda {

inline constexpr int kPieceRows = kPieceEdge * kPieceEdge;
// In shared memory: padded against bank conflicts, rows aligned to 16 bytes.
inline constexpr int kPiecePitch = kPieceWords + 4;
inline constexpr uint32_t kDrawnAtOnce = 32 / kPieceEdge;  // triangles per warp and iteration

struct StoreRoom {
  alignas(16) uint32_t words[kPieceRows * kPiecePitch];
  uint32_t list[kMaxLarge];  // triangles of the grid block
  uint32_t count;
};

// With bins: layers, and the setups of a few triangles that a warp draws at a time.
template <int kThreads>
struct ListedRoom {
  alignas(16) uint32_t words[kPieceRows * kPiecePitch];
  PieceLayer layers[kThreads];
  alignas(16) SharedSetup setups[kThreads / 32][kDrawnAtOnce];
};
template <bool kListed, int kThreads>
struct StoreRoomType {
  using Type = StoreRoom;
};
template <int kThreads>
struct StoreRoomType<true, kThreads> {
  using Type = ListedRoom<kThreads>;
};
template <bool kListed, int kThreads>
using StoreRoomFor = typename StoreRoomType<kListed, kThreads>::Type;

// False if a triangle does not intersect the grid block with first row y, first layer z and voxels [x, x + width).
__device__ inline bool MeetsPiece(const SharedSetup& s, int x, int y, int z, int width) {
  return s.begin[0] < x + width && s.end[0] > x && s.begin[1] < y + kPieceEdge && s.end[1] > y &&
         s.begin[2] < z + kPieceEdge && s.end[2] > z && MayMeet(s, y, z);
}

// Called by all threads of a block.
template <int kThreads>
__device__ inline void ClearPiece(uint32_t* words) {
  const auto quads = reinterpret_cast<uint4*>(words);
  for (int i = int(threadIdx.x); i < kPieceRows * kPiecePitch / 4; i += kThreads) quads[i] = uint4{0, 0, 0, 0};
}

// Lists those of `large` triangles that may intersect the grid block with first row y, first layer z and voxels [x, x +
// width). Returns their number. Clears the words in shared memory if it is not 0. All threads of a block call it.
template <int kThreads>
__device__ inline uint32_t ListLarge(const Bins& bins, uint32_t large, int x, int y, int z, int width,
                                     StoreRoom& room) {
  if (large == 0) return 0;
  if (threadIdx.x == 0) room.count = 0;
  ClearPiece<kThreads>(room.words);
  __syncthreads();
  for (uint32_t i = threadIdx.x; i < large; i += kThreads) {
    if (MeetsPiece(bins.set_up[i], x, y, z, width)) room.list[atomicAdd(&room.count, 1u)] = i;
  }
  __syncthreads();
  return room.count;
}

// Sets voxels [x_begin, x_end) of a row in shared memory; not empty.
__device__ inline void SetSharedRow(uint32_t* row, int x_begin, int x_end) {
  const int length = x_end - x_begin;
  uint32_t* word = row + x_begin / 32;
  if (length <= 32) {  // the usual case
    const uint64_t mask = uint64_t{~0u >> (32 - length)} << (x_begin % 32);
    atomicOr(word, uint32_t(mask));
    if (uint32_t(mask >> 32) != 0) atomicOr(word + 1, uint32_t(mask >> 32));
    return;
  }
  uint32_t* const last = row + (x_end - 1) / 32;
  uint32_t mask = ~0u << (x_begin % 32);
  for (; word < last; ++word) {
    atomicOr(word, mask);
    mask = ~0u;
  }
  atomicOr(last, mask & ~0u >> (31 - (x_end - 1) % 32));
}

// Copies the setups of a warp's next triangles to shared memory, each by the eight lanes whose `t` it is (kNoTriangle:
// none). All loads are issued at once: reading fields from global memory would wait for each. All threads of the warp
// call it.
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

// Draws the first `count` triangles of a bin into shared memory, with row (y, z) of the grid block at kPiecePitch * (y
// + 8*z). x, y, z: where the grid block starts; `width`: its voxels. Warps take four triangles at a time. All threads
// of the block call it; a barrier must follow.
template <int kThreads>
__device__ inline void DrawPiece(const Bins& bins, const uint32_t* triangles, uint32_t count, int x, int y, int z,
                                 int width, ListedRoom<kThreads>& room) {
  const unsigned lane = threadIdx.x % 32;
  PieceLayer* const layers = room.layers + threadIdx.x / 32 * 32;
  SharedSetup* const setups = room.setups[threadIdx.x / 32];
  ClearPiece<kThreads>(room.words);
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

// DrawPiece for triangles that fill most of the grid block: a thread takes a layer, into cleared words. Usually no edge
// is near, and the plane alone bounds the rows.
template <int kThreads>
__device__ inline void DrawLayers(const Bins& bins, const uint32_t* triangles, uint32_t count, int x, int y, int z,
                                  int width, uint32_t* words) {
  const uint32_t lane = threadIdx.x % 32, total = count * kPieceEdge;
  for (uint32_t begins = threadIdx.x - lane; begins < total; begins += kThreads) {
    const uint32_t item = min(begins + lane, total - 1);
    const SharedSetup& s = bins.set_up[triangles[item / kPieceEdge]];
    const int of_piece = int(item % kPieceEdge);
    PieceLayer layer;
    const bool has = begins + lane < total && FindLayer(s, y, z + of_piece, layer);
    // Uniform over the warp: if one lane needs edge tests all lanes do them, since they would wait for it.
    const bool plane_alone = __all_sync(~0u, !has || IsPlaneAlone(s, layer, y)) != 0;
    const auto set = [&](int row, int x_begin, int x_end) {
      x_begin = max(x_begin - x, 0);
      x_end = min(x_end - x, width);
      if (x_begin < x_end) SetSharedRow(words + (of_piece * kPieceEdge + row) * kPiecePitch, x_begin, x_end);
    };
    if (has && plane_alone) {
      ForEachRowOfPlane(s, layer, y, set);
    } else if (has) {
      ForEachRowOf(s, layer, y, set);
    }
    __syncwarp();
  }
}

// Writes grid block (x, y, z). `kQuads`: rows are a multiple of 16 bytes. `kListed`: triangles come from bins;
// otherwise `large` triangles are tested. All threads of a block call it.
template <bool kQuads, bool kListed, int kThreads>
__device__ inline void StorePiece(const BitArgs& args, const Bins& bins, uint32_t large, uint32_t x, uint32_t y,
                                  uint32_t z, StoreRoomFor<kListed, kThreads>& room) {
  constexpr int kEach = kQuads ? 4 : 1, kUnits = kPieceWords / kEach;  // accesses per row
  constexpr int kRowStep = kThreads / kUnits;
  const auto me = int(threadIdx.x);
  const auto words_per_row = int(args.grid.words_per_row), ny = int(args.grid.dims[1]);
  const int z_begin = int(args.grid.slab_begin),
            layers = min(int(args.grid.slab_end) - z_begin - int(z) * kPieceEdge, kPieceEdge);
  const int first_y = int(y) * kPieceEdge, first_z = int(z) * kPieceEdge, first_word = int(x) * kPieceWords;
  const int words = min(kPieceWords, words_per_row - first_word);
  const int first_x = first_word * 32, first_layer_of_grid = first_z + z_begin;
  uint32_t count;
  if constexpr (kListed) {
    const uint32_t piece = x + bins.dims[0] * (y + bins.dims[1] * z);
    count = min(__ldg(bins.counts + piece), kBinRoom);
    if (count > 0) {
      const uint32_t* const triangles = bins.triangles + uint64_t{piece} * kBinRoom;
      DrawPiece(bins, triangles, count, first_x, first_y, first_layer_of_grid, words * 32, room);
    }
  } else {
    count = ListLarge<kThreads>(bins, large, first_x, first_y, first_layer_of_grid, words * 32, room);
    if (count > 0) {
      DrawLayers<kThreads>(bins, room.list, count, first_x, first_y, first_layer_of_grid, words * 32, room.words);
    }
  }
  if (count > 0) __syncthreads();
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

// Writes all grid blocks along z that are stored, and zeros after the last word of the grid up to 16 bytes.
template <bool kQuads, bool kListed, int kThreads>
__device__ inline void StorePieces(const BitArgs& args, const Bins& bins, StoreRoomFor<kListed, kThreads>& room) {
  if (!kQuads && blockIdx.x == 0 && blockIdx.y == 0 && blockIdx.z == 0) ClearBehind(args);
  uint32_t large = 0;
  if constexpr (!kListed) {
    large = args.largest != nullptr ? args.largest->listed()
                                    : uint32_t(min(__ldg(args.queued + kLargeQueue), uint64_t{kMaxLarge}));
  }
  for (uint32_t z = bins.z_begin + blockIdx.z; z < bins.z_end; z += gridDim.z) {
    if (z != bins.z_begin + blockIdx.z) __syncthreads();  // the shared memory is free
    StorePiece<kQuads, kListed, kThreads>(args, bins, large, blockIdx.x, blockIdx.y, z, room);
  }
}

}  // namespace voxelpipe::cuda
