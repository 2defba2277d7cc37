// Makes the bricks of a sparse result from the slab's coverage.
//
// A tile is four bricks along x and one along y and z, so tile order is the order of brick ids.
#include <algorithm>

#include "cuda/primitives/scan.h"
#include "cuda/run/run_state.h"
#include "cuda/scatter/brick_scatter.h"
#include "cuda/traversal/row_traversal.cuh"
#include "pipeline/plan/plan.h"
#include "pipeline/stages/target_rules.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;

struct BrickArgs {
  GridView grid;
  uint64_t tile_count;                // of the slab
  const uint32_t *coverage, *inside;  // bit grids; inside may be null
  uint32_t *brick_counts, *voxel_counts;
  const uint64_t *first_brick, *first_voxel;
  uint32_t* listed_bits;  // if not null: receives the bit index of each voxel; values are stored later
  bool emits;             // true if this kernel stores any values
  TargetViews targets;
  FillValue fill[kMaxTargets];             // of filled results
  const FillValue* of_parts[kMaxTargets];  // as in FillArgs (crossings.cuh)
  const uint16_t* ranks;
  uint64_t all_voxels;
  uint64_t* bricks;
  uint8_t* masks;
  uint8_t* out[kMaxTargets];
};

// Coordinates of the slab's tile among the grid's tiles.
struct TileAt {
  int64_t x, y, z;
};
__device__ inline TileAt Locate(const BrickArgs& args, uint64_t tile) {
  const auto nx = uint64_t(args.grid.tiles.dims[0]), ny = uint64_t(args.grid.tiles.dims[1]);
  return {int64_t(tile % nx), int64_t(tile / nx % ny), int64_t(tile / nx / ny) + args.grid.slab_begin / 8};
}

// Word index of the tile's row in the bit grids; false if the row is outside the grid.
__device__ inline bool RowWord(const BrickArgs& args, const TileAt& at, int row, uint64_t& word) {
  const int64_t y = at.y * 8 + row % 8, z = at.z * 8 + row / 8;
  if (y >= args.grid.dims[1] || z >= args.grid.slab_end) return false;
  word = args.grid.Word(at.x * 32, y, z);
  return true;
}

__device__ inline uint32_t OccupiedWord(const BrickArgs& args, uint64_t word) {
  return args.inside == nullptr ? args.coverage[word] : args.coverage[word] | args.inside[word];
}

// One thread per tile: neighbours along x read adjacent words. One more element is 0, so that the prefix sum ends with
// the total.
__global__ void __launch_bounds__(kThreads) CountBricks(const __grid_constant__ BrickArgs args) {
  const uint64_t tile = uint64_t(blockIdx.x) * kThreads + threadIdx.x;
  if (tile == args.tile_count) args.brick_counts[tile] = args.voxel_counts[tile] = 0;
  if (tile >= args.tile_count) return;
  const TileAt at = Locate(args, tile);
  uint32_t any = 0, voxels = 0;
  for (int row = 0; row < kTileRows; ++row) {
    uint64_t word;
    if (!RowWord(args, at, row, word)) continue;
    const uint32_t bits = OccupiedWord(args, word);
    any |= bits;
    voxels += uint32_t(__popc(bits));
  }
  uint32_t bricks = 0;
  for (int part = 0; part < 4; ++part) bricks += (any >> (8 * part) & 0xff) != 0;
  args.brick_counts[tile] = bricks;
  args.voxel_counts[tile] = voxels;
}

// One thread. Copies the totals next to the other counters that the host reads, since each copy takes about 10 us.
__global__ void CopyTotals(const uint64_t* bricks, const uint64_t* voxels, uint64_t* counters) {
  counters[kListedBricks] = *bricks;
  counters[kListedVoxels] = *voxels;
}

__device__ inline void StoreElement(uint8_t* to, VoxelFormat format, uint64_t at, uint32_t stored) {
  switch (format) {
    case VoxelFormat::kBit:
      if (stored != 0) atomicOr(reinterpret_cast<uint32_t*>(to) + at / 32, 1u << (at % 32));
      break;
    case VoxelFormat::kU8:
    case VoxelFormat::kU8Srgb:
    case VoxelFormat::kU8Snorm: to[at] = uint8_t(stored); break;
    case VoxelFormat::kU16:
    case VoxelFormat::kU16Snorm:
    case VoxelFormat::kF16: reinterpret_cast<uint16_t*>(to)[at] = uint16_t(stored); break;
    default: reinterpret_cast<uint32_t*>(to)[at] = stored; break;
  }
}

// The fill value of the part around a voxel's centre.
__device__ inline const FillValue& FillOfPart(const BrickArgs& args, int t, const int64_t (&at)[3]) {
  const int64_t row = at[1] + args.grid.dims[1] * (at[2] - args.grid.slab_begin);
  return args.of_parts[t][args.ranks[row * args.grid.dims[0] + at[0]] - 1];
}

// Stores the values of voxel `x` of a tile's row as voxel n of the result.
__device__ inline void EmitVoxel(const BrickArgs& args, const TileAt& tile, int row, int x, uint64_t word, uint64_t n) {
  const bool here = (args.coverage[word] >> x & 1) != 0;
  for (int t = 0; t < args.targets.count; ++t) {
    const CudaTarget& target = args.targets.at[t];
    // If another target's fragment covers the voxel and this target's were discarded, it has the value of a dense
    // target.
    const bool kept = here && (!target.own_presence || (target.presence[word] >> x & 1) != 0);
    if (kept && target.format != VoxelFormat::kBit) continue;  // stored by StoreListed
    const bool filled = !here || (args.inside != nullptr && (args.inside[word] >> x & 1) != 0);
    for (int c = 0; c < target.components; ++c) {
      uint32_t stored = target.clear_stored;
      if (!kept && filled) {
        const int64_t at[3] = {tile.x * 32 + x, tile.y * 8 + row % 8, tile.z * 8 + row / 8};
        const FillValue& fill = args.of_parts[t] == nullptr ? args.fill[t] : FillOfPart(args, t, at);
        stored = FillStored(fill, at[0], at[1], at[2], c);
      }
      if (kept) {
        stored = target.is_occupancy || (target.bits[word] >> x & 1) != 0;
      }
      const uint64_t to =
          args.targets.planar ? uint64_t(c) * args.all_voxels + n : n * uint64_t(target.components) + uint64_t(c);
      StoreElement(args.out[t], target.format, to, stored);
    }
  }
}

// One warp: lane l processes rows l and l + 32.
__device__ inline void EmitTile(const BrickArgs& args, uint64_t tile) {
  const int lane = int(threadIdx.x % 32);
  const auto nbx = uint64_t((args.grid.dims[0] + 7) / 8), nby = uint64_t((args.grid.dims[1] + 7) / 8);
  const TileAt at = Locate(args, tile);
  uint64_t words[2] = {0, 0};
  uint32_t bits[2] = {0, 0};
  for (int half = 0; half < 2; ++half) {
    if (RowWord(args, at, lane + 32 * half, words[half])) bits[half] = OccupiedWord(args, words[half]);
  }
  uint64_t brick = args.first_brick[tile], n = args.first_voxel[tile];
  for (int part = 0; part < 4; ++part) {
    const uint32_t low = bits[0] >> (8 * part) & 0xff, high = bits[1] >> (8 * part) & 0xff;
    if (__ballot_sync(~0u, (low | high) != 0) == 0) continue;
    if (lane == 0) {
      args.bricks[brick] = uint64_t(at.x * 4 + part) + nbx * (uint64_t(at.y) + nby * uint64_t(at.z));
    }
    args.masks[brick * 64 + uint64_t(lane)] = uint8_t(low);
    args.masks[brick * 64 + 32 + uint64_t(lane)] = uint8_t(high);
    ++brick;
    for (int half = 0; half < 2; ++half) {
      const uint32_t byte = half == 0 ? low : high;
      uint32_t total;
      uint64_t number = n + WarpExclusiveSum(uint32_t(__popc(byte)), total);
      for (uint32_t left = byte; left != 0; left &= left - 1, ++number) {
        const int x = 8 * part + __ffs(int(left)) - 1;
        if (args.listed_bits != nullptr) args.listed_bits[number] = uint32_t(words[half]) * 32 + uint32_t(x);
        if (args.emits) EmitVoxel(args, at, lane + 32 * half, x, words[half], number);
      }
      n += total;
    }
  }
}

// One warp per tile, 32 tiles at a time, most of which are empty.
__global__ void __launch_bounds__(kThreads) EmitBricks(const __grid_constant__ BrickArgs args) {
  const uint64_t warps = uint64_t(gridDim.x) * (kThreads / 32);
  const uint64_t warp = uint64_t(blockIdx.x) * (kThreads / 32) + threadIdx.x / 32;
  for (uint64_t first = warp; first < args.tile_count; first += 32 * warps) {
    const uint64_t mine = first + threadIdx.x % 32 * warps;
    unsigned occupied = __ballot_sync(~0u, mine < args.tile_count && args.voxel_counts[mine] != 0);
    for (; occupied != 0; occupied &= occupied - 1) {
      EmitTile(args, first + uint64_t(__ffs(int(occupied)) - 1) * warps);
    }
  }
}

}  // namespace

absl::Status MakeBricks(RunState& state) {
  if (state.plan.path == Path::kBricks) return EmitPool(state);
  DeviceResult& out = state.result;
  BrickArgs args{};
  args.grid = state.view;
  const int64_t layers = (state.slab.end + 7) / 8 - state.slab.begin / 8;
  args.tile_count = uint64_t(state.view.tiles.dims[0]) * uint64_t(state.view.tiles.dims[1]) * uint64_t(layers);
  const uint64_t counts = args.tile_count + 1;
  VOXELPIPE_OK_OR_RETURN(state.sparse.brick_counts.Resize(counts, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.sparse.voxel_counts.Resize(counts, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.sparse.first_brick.Resize(counts, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.sparse.first_voxel.Resize(counts, state.stream));
  args.coverage = state.coverage.data();
  args.inside = state.inside.empty() ? nullptr : state.inside.data();
  args.brick_counts = state.sparse.brick_counts.data();
  args.voxel_counts = state.sparse.voxel_counts.data();
  CountBricks<<<unsigned((counts + kThreads - 1) / kThreads), kThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("CountBricks");
  VOXELPIPE_OK_OR_RETURN(ExclusiveScan(state.sparse.brick_counts.data(), state.sparse.first_brick.data(), counts,
                                       state.scratch, state.stream));
  VOXELPIPE_OK_OR_RETURN(ExclusiveScan(state.sparse.voxel_counts.data(), state.sparse.first_voxel.data(), counts,
                                       state.scratch, state.stream));
  VOXELPIPE_OK_OR_RETURN(EnsureCounters(state));
  CopyTotals<<<1, 1, 0, state.stream>>>(state.sparse.first_brick.data() + args.tile_count,
                                        state.sparse.first_voxel.data() + args.tile_count, state.counters.data());
  VOXELPIPE_LAUNCHED_OR_RETURN("CopyTotals");
  const auto counters = ReadCounters(state);
  if (!counters.ok()) return counters.status();
  out.listed_bricks = (*counters)[kListedBricks];
  out.listed_voxels = (*counters)[kListedVoxels];
  VOXELPIPE_OK_OR_RETURN(out.bricks.Resize(out.listed_bricks, state.stream));
  VOXELPIPE_OK_OR_RETURN(out.masks.Resize(out.listed_bricks * 64, state.stream));
  out.targets.resize(size_t(state.targets.count));
  for (int t = 0; t < state.targets.count; ++t) {
    DeviceArray<uint8_t>& values = out.targets[size_t(t)];
    const uint64_t bytes = TargetBytes(state.request.request.targets[size_t(t)], out.listed_voxels);
    VOXELPIPE_OK_OR_RETURN(values.Resize((bytes + 3) / 4 * 4, state.stream));
    if (state.targets.at[t].format == VoxelFormat::kBit) VOXELPIPE_OK_OR_RETURN(values.Fill(0, state.stream));
    args.out[t] = values.data();
    args.fill[t] = FillValueOf(state.request, size_t(t), state.grid);
    if (const auto& of_parts = state.parts.fills[size_t(t)]; !of_parts.empty()) args.of_parts[t] = of_parts.data();
  }
  args.ranks = state.parts.inside_ranks.data();
  if (out.listed_bricks == 0) return absl::OkStatus();
  args.first_brick = state.sparse.first_brick.data();
  args.first_voxel = state.sparse.first_voxel.data();
  args.emits = true;
  bool values_later = false;  // bits are stored here
  for (int t = 0; t < state.targets.count && state.plan.blends(); ++t) {
    values_later = values_later || state.targets.at[t].format != VoxelFormat::kBit;
  }
  if (values_later) {
    VOXELPIPE_OK_OR_RETURN(state.sparse.listed_bits.Resize(out.listed_voxels, state.stream));
    args.listed_bits = state.sparse.listed_bits.data();
    args.emits = args.inside != nullptr;
    for (int t = 0; t < state.targets.count; ++t) {
      const CudaTarget& target = state.targets.at[t];
      args.emits = args.emits || target.format == VoxelFormat::kBit || target.own_presence;
    }
  }
  args.targets = state.targets;
  args.all_voxels = out.listed_voxels;
  args.bricks = out.bricks.data();
  args.masks = out.masks.data();
  const uint64_t blocks = std::min<uint64_t>(uint64_t(state.device.multiprocessors) * 16, (args.tile_count + 7) / 8);
  EmitBricks<<<unsigned(blocks), kThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("EmitBricks");
  return values_later ? StoreListed(state) : absl::OkStatus();
}

}  // namespace voxelpipe::cuda
