// Pairs by tile, where each tile's begin and end, and the parts of tiles that have too many for one block.
#include <cub/device/device_radix_sort.cuh>

#include <algorithm>
#include <bit>

#include "cuda/device/launch.cuh"
#include "cuda/run/run_state.h"
#include "cuda/traversal/row_traversal.cuh"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;

__global__ void __launch_bounds__(kThreads)
    MarkTiles(const uint32_t* tiles, uint64_t count, uint32_t* begin, uint32_t* end, uint32_t* slot, uint32_t* occupied,
              uint64_t* occupied_count) {
  __shared__ unsigned long long room[kThreads / 32 + 1];
  const uint64_t i = uint64_t(blockIdx.x) * kThreads + threadIdx.x;
  bool first = false;
  uint32_t tile = 0;
  if (i < count) {
    tile = tiles[i];
    first = i == 0 || tiles[i - 1] != tile;
    if (first) begin[tile] = uint32_t(i);
    if (i + 1 == count || tiles[i + 1] != tile) end[tile] = uint32_t(i + 1);
  }
  const uint64_t at = BlockAllocate<kThreads>(occupied_count, first, room);
  if (!first) return;
  occupied[at] = tile;
  if (slot != nullptr) slot[tile] = uint32_t(at);
}

// The parts of tiles that have so many pairs that they are split, an occupied tile a thread.
__global__ void __launch_bounds__(kThreads)
    ListParts(const uint32_t* begin, const uint32_t* end, const uint32_t* occupied, uint32_t pairs, TilePart* list,
              uint64_t* counters) {
  __shared__ unsigned long long room[kThreads / 32 + 1];
  const uint64_t count = counters[kOccupied];
  for (uint64_t first = uint64_t(blockIdx.x) * kThreads; first < count; first += uint64_t(gridDim.x) * kThreads) {
    const uint64_t slot = first + threadIdx.x;
    uint32_t parts = 1;
    if (slot < count) parts = PartsOf(end[occupied[slot]] - begin[occupied[slot]], pairs);
    if (__syncthreads_or(parts > 1) == 0) continue;
    const uint64_t at = BlockAllocate<kThreads>(counters + kParts, parts > 1 ? parts : 0, room);
    for (uint32_t p = 0; parts > 1 && p < parts; ++p) list[at + p] = {uint32_t(slot), p};
  }
}

// Lists parts, where some tile may have so many.
absl::Status SplitTiles(RunState& state, uint64_t most_tiles) {
  const uint64_t pairs = state.pairs.count;
  state.part_pairs = uint32_t(std::max<uint64_t>(kMinPartPairs, pairs / kMaxParts));
  if (pairs <= uint64_t{kPartsSplit - 1} * state.part_pairs) return absl::OkStatus();
  // Whole parts, and of each split tile one that is not.
  const uint64_t most = pairs / state.part_pairs + pairs / (uint64_t{kPartsSplit - 1} * state.part_pairs);
  VOXELPIPE_OK_OR_RETURN(state.tile_parts.Resize(most, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.parts_done.Resize(kPartLevels * most, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.parts_done.Fill(0, state.stream));
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kParts}));
  ListParts<<<BlocksFor(most_tiles, kThreads, 1 << 10), kThreads, 0, state.stream>>>(
      state.pairs.begin.data(), state.pairs.end.data(), state.pairs.occupied.data(), state.part_pairs,
      state.tile_parts.data(), state.counters.data());
  VOXELPIPE_LAUNCHED_OR_RETURN("ListParts");
  return absl::OkStatus();
}

}  // namespace

absl::Status SortPairs(TilePairs& pairs, uint64_t tile_count, uint32_t* slot, uint64_t* occupied_count,
                       DeviceArray<uint8_t>& scratch, cudaStream_t stream) {
  pairs.sorted = 0;
  if (pairs.count == 0) return absl::OkStatus();
  cub::DoubleBuffer<uint32_t> keys(pairs.tiles[0].data(), pairs.tiles[1].data());
  cub::DoubleBuffer<uint32_t> values(pairs.triangles[0].data(), pairs.triangles[1].data());
  const int bits = std::max(1, int(std::bit_width(tile_count - 1)));
  const auto count = uint32_t(pairs.count);
  size_t bytes = 0;
  VOXELPIPE_CUDA_OR_RETURN(cub::DeviceRadixSort::SortPairs(nullptr, bytes, keys, values, count, 0, bits, stream));
  VOXELPIPE_OK_OR_RETURN(scratch.Resize(std::max<size_t>(bytes, 1), stream));
  VOXELPIPE_CUDA_OR_RETURN(
      cub::DeviceRadixSort::SortPairs(scratch.data(), bytes, keys, values, count, 0, bits, stream));
  CountLaunch();
  pairs.sorted = values.Current() == pairs.triangles[0].data() ? 0 : 1;
  VOXELPIPE_OK_OR_RETURN(pairs.begin.Resize(tile_count, stream));
  VOXELPIPE_OK_OR_RETURN(pairs.end.Resize(tile_count, stream));
  VOXELPIPE_OK_OR_RETURN(pairs.occupied.Resize(std::min(pairs.count, tile_count), stream));
  MarkTiles<<<unsigned((pairs.count + kThreads - 1) / kThreads), kThreads, 0, stream>>>(
      keys.Current(), pairs.count, pairs.begin.data(), pairs.end.data(), slot, pairs.occupied.data(), occupied_count);
  VOXELPIPE_LAUNCHED_OR_RETURN("MarkTiles");
  return absl::OkStatus();
}

absl::Status TileSort(RunState& state) {
  const uint64_t pairs = state.pairs.count, tiles = FirstTile(state, state.tile_layers.end) - FirstTile(state);
  const bool sparse = state.request.request.result == ResultKind::kSparse;
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kOccupied}));
  state.pairs.sorted = 0;
  state.occupied_count = 0;
  if (sparse) {
    VOXELPIPE_OK_OR_RETURN(state.tile_slot.Resize(tiles, state.stream));
    VOXELPIPE_OK_OR_RETURN(state.tile_slot.Fill(0xff, state.stream));
  }
  state.tile_parts.Free();
  if (pairs == 0) return absl::OkStatus();
  VOXELPIPE_OK_OR_RETURN(SortPairs(state.pairs, tiles, sparse ? state.tile_slot.data() : nullptr,
                                   state.counters.data() + kOccupied, state.scratch, state.stream));
  VOXELPIPE_OK_OR_RETURN(SplitTiles(state, std::min(pairs, tiles)));
  if (!sparse) return absl::OkStatus();  // only the values of sparse results take memory by the tile
  auto counters = ReadCounters(state);
  if (!counters.ok()) return counters.status();
  state.occupied_count = (*counters)[kOccupied];
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
