// Per tile: row spans, fragment shading and blending in shared memory, store.
#include <algorithm>
#include <vector>

#include "cuda/fine_raster_kernel.cuh"
#include "cuda/run_state.h"

namespace voxelpipe::cuda {
namespace {

// Two blocks a multiprocessor fit with this much shared memory each.
constexpr int kGroupWords = 100 * 1024 / 4;

// Targets in groups whose tiles fit into shared memory together; each group is a launch, and rasterizes anew.
std::vector<FineArgs> GroupTargets(const RunState& state) {
  std::vector<FineArgs> groups;
  int words = 0;
  for (int i = 0; i < state.targets.count; ++i) {
    TileTarget t;
    t.target = state.targets.at[i];
    t.index = i;
    const int end = PlaceTileTarget(t, words);
    if (groups.empty() || (end > kGroupWords && words > 0)) {
      groups.emplace_back();
      words = PlaceTileTarget(t, 0);
    } else {
      words = end;
    }
    FineArgs& group = groups.back();
    group.targets[group.target_count++] = t;
    group.has_owners = group.has_owners || t.has_owner();
    if (t.kept == Kept::kNothing) continue;
    group.shades = true;
    group.traits |= TraitsOf(t.target.shader);
  }
  return groups;
}

int SharedBytes(const FineArgs& group) {
  int words = 0;
  for (int i = 0; i < group.target_count; ++i) {
    TileTarget t = group.targets[i];
    words = PlaceTileTarget(t, words);
  }
  return words * 4;
}

template <bool kShades>
absl::Status Launch(const RunState& state, const FineArgs& args) {
  const int shared = SharedBytes(args);
  VOXELPIPE_CUDA_OR_RETURN(
      cudaFuncSetAttribute(FineRasterKernel<kShades>, cudaFuncAttributeMaxDynamicSharedMemorySize, shared));
  int resident = 1;
  VOXELPIPE_CUDA_OR_RETURN(cudaOccupancyMaxActiveBlocksPerMultiprocessor(&resident, FineRasterKernel<kShades>,
                                                                         kFineThreads, size_t(shared)));
  const auto blocks = unsigned(std::max(1, resident) * state.device.multiprocessors);
  FineRasterKernel<kShades><<<blocks, kFineThreads, size_t(shared), state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("FineRasterKernel");
  return absl::OkStatus();
}

}  // namespace

absl::Status FineRaster(RunState& state) {
  if (state.plain_bits) {
    return RasterRows(state, state.request.request.coverage, state.slab.begin, state.slab.end, state.coverage.data());
  }
  if (state.pair_count == 0) return absl::OkStatus();
  std::vector<FineArgs> groups = GroupTargets(state);
  for (size_t g = 0; g < groups.size(); ++g) {
    FineArgs& args = groups[g];
    args.grid = state.view;
    args.mesh = state.mesh.view.data();
    args.coverage = state.request.request.coverage;
    args.pair_triangles = state.pair_triangles[state.sorted].data();
    args.tile_begin = state.tile_begin.data();
    args.tile_end = state.tile_end.data();
    args.occupied_tiles = state.occupied_tiles.data();
    args.occupied_count = state.counters.data() + kOccupied;
    args.next_tile = state.counters.data() + kNextTile;
    args.fragments = g == 0 ? state.counters.data() + kFragments : nullptr;
    args.coverage_bits = state.coverage.data();
    args.any_always_present = state.targets.any_always_present;
    args.planar = state.targets.planar;
    args.slab_voxels = state.slab_voxels();
    if (state.request.request.result == ResultKind::kSparse) {
      args.tile_values = state.tile_values.data();
      args.value_stride = state.value_stride;
      std::copy(state.value_offset.begin(), state.value_offset.end(), args.value_offset);
    }
    VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kNextTile}));
    VOXELPIPE_OK_OR_RETURN(args.shades ? Launch<true>(state, args) : Launch<false>(state, args));
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
