// Per tile: row spans, fragment shading and blending in shared memory, store.
#include <algorithm>
#include <map>
#include <mutex>
#include <utility>
#include <vector>

#include "cuda/primitives/list_sizes.h"
#include "cuda/run/run_state.h"
#include "cuda/tiles/fine_raster_kernel.cuh"

namespace voxelpipe::cuda {
namespace {

// Two blocks a multiprocessor fit with this much shared memory each.
constexpr int kGroupWords = kTargetGroupBytes / 4;

// Targets in groups whose tiles fit into shared memory together; each group is a launch, and rasterizes anew.
std::vector<FineArgs> GroupTargets(const TargetViews& targets) {
  std::vector<FineArgs> groups;
  int words = 0;
  for (int i = 0; i < targets.count; ++i) {
    TileTarget t;
    t.target = targets.at[i];
    t.index = i;
    const int end = PlaceTileTarget(t, words);
    if (groups.empty() || (end > kGroupWords && words > 0)) {
      groups.emplace_back();
      words = PlaceTileTarget(t, 0);
    } else {
      words = end;
    }
    FineArgs& group = groups.back();
    group.any_always_present = targets.any_always_present;
    group.planar = targets.planar;
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

// Lets the kernel have so much shared memory on the device. The bound is the kernel's and not the launch's: other
// threads launch it at the same time, so it only grows. Said every time, for a device that was reset has forgotten it.
template <typename Kernel>
absl::Status AllowShared(int ordinal, Kernel kernel, int bytes) {
  static std::mutex mutex;
  static auto* const allowed = new std::map<std::pair<int, Kernel>, int>;
  const std::lock_guard lock(mutex);
  int& most = (*allowed)[{ordinal, kernel}];
  const int wanted = std::max(most, bytes);
  VOXELPIPE_CUDA_OR_RETURN(cudaFuncSetAttribute(kernel, cudaFuncAttributeMaxDynamicSharedMemorySize, wanted));
  most = wanted;
  return absl::OkStatus();
}

// Room for the parts of split tiles.
absl::Status PlaceParts(RunState& state, FineArgs& args) {
  if (state.tile_parts.empty()) return absl::OkStatus();
  args.parts.list = state.tile_parts.data();
  args.parts.count = state.counters.data() + kParts;
  args.parts.pairs = state.part_pairs;
  args.parts.capacity = uint32_t(state.tile_parts.size());
  const uint64_t words = uint64_t(args.shared_words) + 2 * kTileRows;
  VOXELPIPE_OK_OR_RETURN(
      state.part_results.Resize(std::max(state.part_results.size(), words * state.tile_parts.size()), state.stream));
  args.parts.results = state.part_results.data();
  args.parts.done = state.parts_done.data();
  return absl::OkStatus();
}

// Blocks that the device runs at once.
template <typename Kernel>
absl::StatusOr<unsigned> ResidentBlocks(const DeviceInfo& device, Kernel kernel, int threads, int shared_bytes) {
  VOXELPIPE_OK_OR_RETURN(AllowShared(device.ordinal, kernel, shared_bytes));
  int resident = 1;
  VOXELPIPE_CUDA_OR_RETURN(
      cudaOccupancyMaxActiveBlocksPerMultiprocessor(&resident, kernel, threads, size_t(shared_bytes)));
  return unsigned(std::max(1, resident) * device.multiprocessors);
}

absl::Status Launch(RunState& state, FineArgs& args) {
  const auto kernel = args.shades ? FineRasterKernel<true> : FineRasterKernel<false>;
  const int shared = (SharedBytes(args) + 15) / 16 * 16;
  args.shared_words = shared / 4;
  VOXELPIPE_OK_OR_RETURN(PlaceParts(state, args));
  const absl::StatusOr<unsigned> blocks = ResidentBlocks(state.device, kernel, kFineThreads, shared);
  if (!blocks.ok()) return blocks.status();
  kernel<<<*blocks, kFineThreads, size_t(shared), state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("FineRasterKernel");
  return absl::OkStatus();
}

}  // namespace

absl::Status FineRaster(RunState& state) {
  if (state.plan.path == Path::kNothing) return absl::OkStatus();
  if (state.plan.path == Path::kOccupancy) {
    return RasterRows(state, state.request.request.coverage, state.slab.begin, state.slab.end, state.coverage.data(),
                      state.coverage.size());
  }
  if (state.plan.blends()) return BlendDirectly(state);
  if (state.pairs.count == 0) return absl::OkStatus();
  std::vector<FineArgs> groups = GroupTargets(state.targets);
  for (size_t g = 0; g < groups.size(); ++g) {
    FineArgs& args = groups[g];
    args.grid = state.view;
    args.mesh = state.mesh.view.data();
    args.codes = state.mesh.codes.data();
    args.coverage = state.request.request.coverage;
    args.pair_triangles = state.pairs.triangles[state.pairs.sorted].data();
    args.tile_begin = state.pairs.begin.data();
    args.tile_end = state.pairs.end.data();
    args.occupied_tiles = state.pairs.occupied.data();
    args.occupied_count = state.counters.data() + kOccupied;
    args.first_tile = FirstTile(state);
    args.next_tile = state.counters.data() + kNextTile;
    args.fragments = g == 0 ? state.counters.data() + kFragments : nullptr;
    args.coverage_bits = state.coverage.data();
    args.slab_voxels = state.slab_voxels();
    if (state.request.request.result == ResultKind::kSparse) {
      args.tile_values = state.tile_values.data();
      args.value_stride = state.value_stride;
      std::copy(state.value_offset.begin(), state.value_offset.end(), args.value_offset);
    }
    VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kNextTile}));
    VOXELPIPE_OK_OR_RETURN(Launch(state, args));
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
