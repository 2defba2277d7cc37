// Pairs by tile, where each tile's begin and end, and the parts of tiles that have too many for one block.
#include <cub/device/device_radix_sort.cuh>

#include <algorithm>
#include <bit>

#include "cuda/launch.h"
#include "cuda/row_walk.cuh"
#include "cuda/run_state.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;

__global__ void __launch_bounds__(kThreads)
    MarkTiles(const uint32_t* tiles, uint64_t count, uint32_t* begin, uint32_t* end, uint32_t* slot, uint32_t* occupied,
              uint64_t* counters) {
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
  const uint64_t at = BlockAllocate<kThreads>(counters + kOccupied, first, room);
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
  const uint64_t pairs = state.pair_count;
  state.part_pairs = uint32_t(std::max<uint64_t>(kLeastPartPairs, pairs / kMostParts));
  if (pairs <= uint64_t{kPartsSplit - 1} * state.part_pairs) return absl::OkStatus();
  // Whole parts, and of each split tile one that is not.
  const uint64_t most = pairs / state.part_pairs + pairs / (uint64_t{kPartsSplit - 1} * state.part_pairs);
  VOXELPIPE_OK_OR_RETURN(state.tile_parts.Resize(most, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.parts_done.Resize(kPartLevels * most, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.parts_done.Fill(0, state.stream));
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kParts}));
  ListParts<<<BlocksFor(most_tiles, kThreads, 1 << 10), kThreads, 0, state.stream>>>(
      state.tile_begin.data(), state.tile_end.data(), state.occupied_tiles.data(), state.part_pairs,
      state.tile_parts.data(), state.counters.data());
  VOXELPIPE_LAUNCHED_OR_RETURN("ListParts");
  return absl::OkStatus();
}

}  // namespace

absl::Status TileSort(RunState& state) {
  const uint64_t pairs = state.pair_count, tiles = state.view.tiles.count();
  const bool sparse = state.request.request.result == ResultKind::kSparse;
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kOccupied}));
  state.sorted = 0;
  state.occupied_count = 0;
  if (sparse) {
    VOXELPIPE_OK_OR_RETURN(state.tile_slot.Resize(tiles, state.stream));
    VOXELPIPE_OK_OR_RETURN(state.tile_slot.Fill(0xff, state.stream));
  }
  state.tile_parts.Free();
  if (pairs == 0) return absl::OkStatus();
  cub::DoubleBuffer<uint32_t> keys(state.pair_tiles[0].data(), state.pair_tiles[1].data());
  cub::DoubleBuffer<uint32_t> values(state.pair_triangles[0].data(), state.pair_triangles[1].data());
  const int bits = std::max(1, int(std::bit_width(tiles - 1)));
  size_t scratch = 0;
  VOXELPIPE_CUDA_OR_RETURN(
      cub::DeviceRadixSort::SortPairs(nullptr, scratch, keys, values, uint32_t(pairs), 0, bits, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.scratch.Resize(std::max<size_t>(scratch, 1), state.stream));
  VOXELPIPE_CUDA_OR_RETURN(cub::DeviceRadixSort::SortPairs(state.scratch.data(), scratch, keys, values, uint32_t(pairs),
                                                           0, bits, state.stream));
  state.sorted = values.Current() == state.pair_triangles[0].data() ? 0 : 1;
  VOXELPIPE_OK_OR_RETURN(state.tile_begin.Resize(tiles, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.tile_end.Resize(tiles, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.occupied_tiles.Resize(std::min(pairs, tiles), state.stream));
  MarkTiles<<<unsigned((pairs + kThreads - 1) / kThreads), kThreads, 0, state.stream>>>(
      keys.Current(), pairs, state.tile_begin.data(), state.tile_end.data(), sparse ? state.tile_slot.data() : nullptr,
      state.occupied_tiles.data(), state.counters.data());
  VOXELPIPE_LAUNCHED_OR_RETURN("MarkTiles");
  VOXELPIPE_OK_OR_RETURN(SplitTiles(state, std::min(pairs, tiles)));
  if (!sparse) return absl::OkStatus();  // only the values of sparse results take memory by the tile
  auto counters = ReadCounters(state);
  if (!counters.ok()) return counters.status();
  state.occupied_count = (*counters)[kOccupied];
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
