// Plain bits: the few largest triangles of a mesh of many are drawn while the grid is cleared, by pieces (bit_bins.cuh). So they
// take no access of memory but the grid's own, where an atomic for each triangle's row takes one each.
// No host-only includes.
#pragma once

#include "cuda/bit_bins.cuh"

namespace voxelpipe::cuda {

template <int kThreads>
struct LargestRoom {
  SharedSetup setups[kMostApart];
  StoreRoom<kThreads> piece;
};

// Writes the whole grid, with args.largest in it and no others, by block `block` of `blocks`. All threads of a block call it.
template <bool kQuads, int kThreads>
__device__ inline void StoreLargest(const BitArgs& args, uint32_t block, uint32_t blocks, LargestRoom<kThreads>& room) {
  const uint32_t count = args.largest->listed();
  const auto slab_begin = int(args.grid.slab_begin);
  if (threadIdx.x < count) {
    SharedSetup& s = room.setups[threadIdx.x];
    if (SetUpLayers(args, args.largest->triangles[threadIdx.x], s) == 0) s.begin[2] = s.end[2] = slab_begin - 1;
  }
  if (!kQuads && block == 0) ClearBehind(args);
  Bins bins;
  bins.set_up = room.setups;
  const auto pieces_of = [](int64_t n, int edge) { return uint32_t((n + edge - 1) / edge); };
  const uint32_t along_x = pieces_of(args.grid.words_per_row, kPieceWords),
                 along_y = pieces_of(args.grid.dims[1], kPieceEdge),
                 along_z = pieces_of(args.grid.slab_end - args.grid.slab_begin, kPieceEdge);
  const uint64_t pieces = uint64_t{along_x} * along_y * along_z;
  for (uint64_t piece = block; piece < pieces; piece += blocks) {
    const auto yz = uint32_t(piece / along_x), x = uint32_t(piece % along_x);
    __syncthreads();  // the set-ups stand, and the room is free
    StorePiece<kQuads, false>(args, bins, count, x, yz % along_y, yz / along_y, room.piece);
  }
}

}  // namespace voxelpipe::cuda
