// Pairs (tile, triangle): what the coarse raster finds, sorted by tile for the fine raster.
#pragma once

#include <cstdint>

#include "cuda/device/buffer.h"

namespace voxelpipe::cuda {

// Pairs are numbered in 32 bits, and blocks step some beyond the last one.
inline constexpr uint64_t kMaxPairs = UINT32_MAX - 4096;

struct TilePairs {
  DeviceArray<uint32_t> tiles[2], triangles[2];  // unsorted and sorted by tile
  uint64_t count = 0;
  int sorted = 0;                    // which of the two the sorted pairs are in
  DeviceArray<uint32_t> begin, end;  // per tile: its pairs; valid for occupied tiles
  DeviceArray<uint32_t> occupied;    // tiles with pairs, in no order

  absl::Status MakeRoom(uint64_t pairs, cudaStream_t stream) {
    for (auto* arrays : {&tiles, &triangles}) {
      for (auto& array : *arrays) VOXELPIPE_OK_OR_RETURN(array.Resize(pairs, stream));
    }
    return absl::OkStatus();
  }
};

// Sorts the pairs by tile, and lists the occupied tiles of `tile_count`: their number is added to *occupied_count.
// `slot`, if not null, gets each occupied tile's number in the list. `scratch` is CUB's.
absl::Status SortPairs(TilePairs& pairs, uint64_t tile_count, uint32_t* slot, uint64_t* occupied_count,
                       DeviceArray<uint8_t>& scratch, cudaStream_t stream);  // tile_sort.cu

}  // namespace voxelpipe::cuda
