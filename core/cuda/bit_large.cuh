// Plain bits: the few largest triangles of a mesh of many, drawn by pieces (bit_bins.cuh) over what stands in the grid. A row of a piece
// takes few accesses of memory then, where an atomic for each triangle's row takes one each.
// No host-only includes.
#pragma once

#include "cuda/bit_bins.cuh"

namespace voxelpipe::cuda {

inline constexpr uint32_t kMostOverdrawn = 32;  // of the large queue, from its begin on

template <int kThreads>
struct OverdrawRoom {
  SharedSetup setups[kMostOverdrawn];
  uint32_t first[2], end[2];  // the pieces, along y and z, that any of them meets
  StoreRoom<kThreads> piece;
};

// Adds what was drawn of a piece to the grid, whose rows nobody else changes meanwhile. In: its first row, layer of the slab and word.
template <bool kQuads, int kThreads>
__device__ inline void AddPiece(const BitArgs& args, int y, int z, int word, const StoreRoom<kThreads>& room) {
  constexpr int kEach = kQuads ? 4 : 1, kUnits = kPieceWords / kEach;
  const auto words_per_row = int(args.grid.words_per_row), ny = int(args.grid.dims[1]);
  const int layers = int(args.grid.slab_end - args.grid.slab_begin);
  for (int i = int(threadIdx.x); i < kPieceRows * kUnits; i += kThreads) {
    const int row = i / kUnits, unit = i % kUnits * kEach, row_y = y + row % kPieceEdge, row_z = z + row / kPieceEdge;
    if (row_y >= ny || row_z >= layers || word + unit >= words_per_row) continue;
    const uint32_t* const drawn = room.words + row * kPiecePitch + unit;
    uint32_t* const to = args.bits +
                         (uint64_t(uint32_t(ny)) * uint32_t(row_z) + uint32_t(row_y)) * uint32_t(words_per_row) +
                         uint32_t(word + unit);
    if constexpr (kQuads) {
      const uint4 more = *reinterpret_cast<const uint4*>(drawn);
      if ((more.x | more.y | more.z | more.w) == 0) continue;
      uint4 all = *reinterpret_cast<const uint4*>(to);
      all.x |= more.x, all.y |= more.y, all.z |= more.z, all.w |= more.w;
      *reinterpret_cast<uint4*>(to) = all;
    } else if (*drawn != 0) {
      *to |= *drawn;
    }
  }
}

// Draws the first of the large queue, by block `block` of `blocks`. All threads of a block call it.
template <bool kQuads, int kThreads>
__device__ inline void OverdrawLarge(const BitArgs& args, uint32_t block, uint32_t blocks,
                                     OverdrawRoom<kThreads>& room) {
  const auto count = uint32_t(min(__ldcg(args.queued + kLargeQueue), uint64_t{kMostOverdrawn}));
  if (count == 0) return;
  const unsigned lane = threadIdx.x % 32;
  if (threadIdx.x < 2) room.first[threadIdx.x] = ~0u, room.end[threadIdx.x] = 0;
  __syncthreads();
  const auto slab_begin = int(args.grid.slab_begin);
  if (threadIdx.x < count) {
    SharedSetup& s = room.setups[threadIdx.x];
    if (SetUpLayers(args, __ldcg(args.large_queue + threadIdx.x), s) == 0) {
      s.begin[2] = s.end[2] = slab_begin - 1;
    } else {
      const PieceBox box = PiecesOf(s, slab_begin);
      for (int a = 0; a < 2; ++a) {
        atomicMin(room.first + a, box.first[a + 1]);
        atomicMax(room.end + a, box.first[a + 1] + box.size[a + 1]);
      }
    }
  }
  __syncthreads();
  if (room.first[1] >= room.end[1]) return;
  Bins bins;
  bins.set_up = room.setups;
  const auto words_per_row = uint32_t(args.grid.words_per_row);
  const uint32_t along_x = (words_per_row + kPieceWords - 1) / kPieceWords, along_y = room.end[0] - room.first[0];
  const uint64_t pieces = uint64_t{along_x} * along_y * (room.end[1] - room.first[1]);
  for (uint64_t piece = block; piece < pieces; piece += blocks) {
    const auto yz = uint32_t(piece / along_x), word = uint32_t(piece % along_x) * kPieceWords;
    const int y = int(room.first[0] + yz % along_y) * kPieceEdge, z = int(room.first[1] + yz / along_y) * kPieceEdge;
    const int x = int(word) * 32, width = int(min(words_per_row - word, uint32_t{kPieceWords})) * 32;
    const bool meets = lane < count && MeetsPiece(room.setups[lane], x, y, slab_begin + z, width);
    const uint32_t meeting = __ballot_sync(~0u, meets);
    if (meeting == 0) continue;
    __syncthreads();  // the room is free
    if (threadIdx.x < 32 && meets) room.piece.list[__popc(meeting & ((1u << lane) - 1))] = lane;
    DrawLayers(bins, room.piece.list, uint32_t(__popc(meeting)), x, y, slab_begin + z, width, room.piece);
    __syncthreads();
    AddPiece<kQuads>(args, y, z, int(word), room.piece);
  }
}

}  // namespace voxelpipe::cuda
