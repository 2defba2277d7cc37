// Launches the brick-pool path: sparse results blended in bricks that are allocated during rasterization
// (brick_scatter.cuh).
#include <algorithm>

#include "cuda/coverage/coverage_pass.h"
#include "cuda/device/launch.cuh"
#include "cuda/primitives/list_sizes.h"
#include "cuda/primitives/scan.h"
#include "cuda/scatter/brick_scatter.h"
#include "cuda/scatter/brick_scatter_kernels.cuh"
#include "cuda/scatter/store_values.h"
#include "cuda/shading/shade_list.h"
#include "pipeline/plan/plan.h"

namespace voxelpipe::cuda {
namespace {

// Capacity of the pool in slots, limited to a share of the device memory.
uint64_t CapacityOf(const RunState& state) {
  constexpr uint64_t kPartOfMemory = 32;
  const uint64_t most = std::min(state.device.memory_bytes, MemoryLimit()) / kPartOfMemory / (kBrickCells * 4);
  return std::min(BrickPoolRoom(state.view.dims[0], state.view.dims[1], state.slab.depth()), most);
}

uint64_t TilesOf(const RunState& state) {
  const auto layers = uint64_t(state.slab.depth() + 7) / 8;
  return uint64_t(state.view.tiles.dims[0]) * uint64_t(state.view.tiles.dims[1]) * layers;
}

absl::Status MakeRoom(RunState& state) {
  PoolMemory& memory = state.sparse.pool;
  const uint64_t capacity = CapacityOf(state);
  if (capacity == 0) return absl::ResourceExhaustedError("no share of the memory is large enough for a brick");
  VOXELPIPE_OK_OR_RETURN(memory.places.Resize(TilesOf(state) * 4, state.stream));
  VOXELPIPE_OK_OR_RETURN(memory.cells.Resize(capacity * kBrickCells, state.stream));
  VOXELPIPE_OK_OR_RETURN(memory.masks.Resize(capacity * kMaskWordsOfBrick, state.stream));
  VOXELPIPE_OK_OR_RETURN(memory.bricks.Resize(capacity, state.stream));
  return memory.voxels.Resize(capacity, state.stream);
}

BrickPool PoolOf(RunState& state) {
  PoolMemory& memory = state.sparse.pool;
  BrickPool pool;
  pool.places = memory.places.data();
  pool.cells = memory.cells.data();
  pool.bricks = memory.bricks.data();
  pool.asked = state.counters.data() + kPooled;
  pool.capacity = uint32_t(memory.bricks.size());
  pool.tiles_x = uint32_t(state.view.tiles.dims[0]);
  pool.tiles_y = uint32_t(state.view.tiles.dims[1]);
  return pool;
}

PoolResultArgs ResultOf(RunState& state) {
  PoolResultArgs args;
  args.pool = PoolOf(state);
  args.masks = state.sparse.pool.masks.data();
  args.voxels = state.sparse.pool.voxels.data();
  args.tiles = TilesOf(state);
  args.brick_counts = state.sparse.brick_counts.data();
  args.voxel_counts = state.sparse.voxel_counts.data();
  args.first_brick = state.sparse.first_brick.data();
  args.first_voxel = state.sparse.first_voxel.data();
  return args;
}

void GoWithout(RunState& state) {
  cuda::GoWithoutBricks(state.path_inputs, state.plan);
  state.sparse.pool.Free();
}

unsigned BlocksOfPlaces(const RunState& state) {
  constexpr uint64_t kPlacesOfBlock = kPoolThreads / 32;
  return BlocksFor(state.sparse.pool.bricks.size() * kPlacesOfBlock, kPoolThreads,
                   uint64_t(state.device.multiprocessors) * 16);
}

// One thread. Copies the totals next to the other counters that the host reads.
__global__ void CopyPoolTotals(const uint64_t* bricks, const uint64_t* voxels, uint64_t* counters) {
  counters[kListedBricks] = *bricks;
  counters[kListedVoxels] = counters[kVoxels] = *voxels;
}

// Assigns result positions to the bricks and voxels of the pool after rasterization.
absl::Status Number(RunState& state) {
  const uint64_t tiles = TilesOf(state), counts = tiles + 1;
  for (auto* array : {&state.sparse.brick_counts, &state.sparse.voxel_counts}) {
    VOXELPIPE_OK_OR_RETURN(array->Resize(counts, state.stream));
  }
  for (auto* array : {&state.sparse.first_brick, &state.sparse.first_voxel}) {
    VOXELPIPE_OK_OR_RETURN(array->Resize(counts, state.stream));
  }
  const PoolResultArgs args = ResultOf(state);
  MaskPlaces<<<BlocksOfPlaces(state), kPoolThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("MaskPlaces");
  CountTiles<<<unsigned((counts + kPoolThreads - 1) / kPoolThreads), kPoolThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("CountTiles");
  VOXELPIPE_OK_OR_RETURN(ExclusiveScan(state.sparse.brick_counts.data(), state.sparse.first_brick.data(), counts,
                                       state.scratch, state.stream));
  VOXELPIPE_OK_OR_RETURN(ExclusiveScan(state.sparse.voxel_counts.data(), state.sparse.first_voxel.data(), counts,
                                       state.scratch, state.stream));
  CopyPoolTotals<<<1, 1, 0, state.stream>>>(state.sparse.first_brick.data() + tiles,
                                            state.sparse.first_voxel.data() + tiles, state.counters.data());
  VOXELPIPE_LAUNCHED_OR_RETURN("CopyPoolTotals");
  return absl::OkStatus();
}

}  // namespace

absl::Status BlendIntoPool(RunState& state, const InPlaceArgs& blend, bool by_id) {
  if (!MakeRoom(state).ok()) {  // the fallback path needs less memory
    GoWithout(state);
    return absl::OkStatus();
  }
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kPooled}));
  VOXELPIPE_OK_OR_RETURN(state.sparse.pool.places.Fill(0, state.stream));
  PoolWriterArgs args;
  args.pool = PoolOf(state);
  args.blend = blend;
  args.by_ny = MakeDivisor(uint32_t(state.view.dims[1]));
  args.fragments = FragmentSlots(state);
  VOXELPIPE_OK_OR_RETURN(FindAllCells(state, CellSink::kPool, args.fragments, &blend, by_id, &args.pool));
  constexpr int kById = int(FragmentShaderId::kTriangleId);
  const auto emit_waiting = by_id ? EmitWaiting<PoolWriter<kById>> : EmitWaiting<PoolWriter<-1>>;
  VOXELPIPE_OK_OR_RETURN(emit_waiting(state, MakeRestArgs(state, 0, state.mesh.host_view.triangle_count, false), args));
  VOXELPIPE_OK_OR_RETURN(Number(state));
  const auto counters = ReadCounters(state);
  if (!counters.ok()) return counters.status();
  if ((*counters)[kPooled] > args.pool.capacity) GoWithout(state);
  state.result.listed_bricks = (*counters)[kListedBricks];
  state.result.listed_voxels = (*counters)[kListedVoxels];
  return absl::OkStatus();
}

absl::Status EmitPool(RunState& state) {
  const CudaTarget& target = state.targets.at[0];
  const bool sparse = state.request.request.result == ResultKind::kSparse;
  const bool owners = state.plan.targets[0].source == ValueSource::kOwners;
  DeviceResult& out = state.result;
  if (sparse) {
    VOXELPIPE_OK_OR_RETURN(out.bricks.Resize(out.listed_bricks, state.stream));
    VOXELPIPE_OK_OR_RETURN(out.masks.Resize(out.listed_bricks * 64, state.stream));
    out.targets.resize(1);
    const uint64_t bytes = TargetBytes(state.request.request.targets[0], out.listed_voxels);
    VOXELPIPE_OK_OR_RETURN(out.targets[0].Resize((bytes + 3) / 4 * 4, state.stream));
  }
  if (out.listed_bricks == 0) return absl::OkStatus();
  PoolResultArgs args = ResultOf(state);
  args.bricks_x = uint64_t(state.view.dims[0] + 7) / 8;
  args.bricks_y = uint64_t(state.view.dims[1] + 7) / 8;
  args.first_layer = uint64_t(state.slab.begin) / 8;
  args.bricks = out.bricks.data();
  args.out_masks = reinterpret_cast<uint32_t*>(out.masks.data());
  args.format = target.format;
  args.complement = target.blend == Blend::kMin || target.blend == Blend::kFirst;
  if (sparse) args.out = out.targets[0].data();
  if (owners) {
    VOXELPIPE_OK_OR_RETURN(state.owners.keys.Resize(out.listed_voxels, state.stream));
    VOXELPIPE_OK_OR_RETURN(state.owners.triangles.Resize(out.listed_voxels, state.stream));
    args.voxel_keys = state.owners.keys.data();
    args.owners = state.owners.triangles.data();
    args.nx = uint32_t(state.view.dims[0]);
    args.ny = uint32_t(state.view.dims[1]);
  }
  EmitPlaces<<<BlocksOfPlaces(state), kPoolThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("EmitPlaces");
  if (!owners) return absl::OkStatus();
  FragmentList list;
  list.keys = args.voxel_keys;
  list.triangles = args.owners;
  list.count = out.listed_voxels;
  list.to = sparse ? nullptr : args.voxel_keys;
  list.plane = sparse ? 0 : state.slab_voxels();
  return ShadeList(state, 0, list, sparse ? args.out : target.dense);
}

}  // namespace voxelpipe::cuda
