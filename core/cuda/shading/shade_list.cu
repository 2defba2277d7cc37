// The kernels that shade lists of fragments, and their launches; also launches the shading of coverage.
#include "cuda/shading/shade_list.h"

#include "cuda/coverage/accumulators.h"
#include "cuda/device/launch.cuh"
#include "cuda/shading/coverage_shading.cuh"
#include "cuda/traversal/raster_args.h"

namespace voxelpipe::cuda {
namespace {

struct ListArgs {
  GridView grid;
  CudaTarget targets[kMaxTargets];
  FragmentShading shading;  // except pointers to the members of this struct
  uint8_t* out[kMaxTargets];
};

__device__ inline FragmentShading ShadingOf(const ListArgs& args) {
  FragmentShading shading = args.shading;
  shading.grid = &args.grid;
  shading.targets = args.targets;
  shading.out = args.out;
  return shading;
}

// One thread per fragment.
__global__ void __launch_bounds__(kShadeThreads) ShadeFragments(const __grid_constant__ ListArgs args) {
  const uint64_t rounded = (args.shading.count + 31) / 32 * 32, step = uint64_t(gridDim.x) * kShadeThreads;
  for (uint64_t i = uint64_t(blockIdx.x) * kShadeThreads + threadIdx.x; i < rounded; i += step) {
    WriteValues(ShadingOf(args), i);
  }
}

// One byte per fragment: 1 if some target keeps it.
__global__ void __launch_bounds__(kShadeThreads) MarkKept(const __grid_constant__ ListArgs args, uint8_t* kept) {
  const uint64_t step = uint64_t(gridDim.x) * kShadeThreads;
  for (uint64_t i = uint64_t(blockIdx.x) * kShadeThreads + threadIdx.x; i < args.shading.count; i += step) {
    kept[i] = IsKept(ShadingOf(args), i);
  }
}

// For targets [begin, end).
ListArgs MakeListArgs(RunState& state, const FragmentList& list, int begin, int end) {
  ListArgs args{};
  args.grid = state.view;
  FragmentShading& shading = args.shading;
  for (int t = begin; t < end; ++t) {
    args.targets[shading.target_count++] = state.targets.at[t];
    shading.traits |= TraitsOf(state.targets.at[t].shader);
  }
  shading.mesh = state.mesh.view.data();
  shading.planar = state.targets.planar;
  shading.keys = list.keys;
  shading.triangles = list.triangles;
  shading.count = list.count;
  shading.to = list.to;
  shading.plane = list.plane;
  return args;
}

absl::Status Launch(RunState& state, const ListArgs& args) {
  if (args.shading.count == 0) return absl::OkStatus();
  ShadeFragments<<<BlocksFor(args.shading.count, kShadeThreads), kShadeThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ShadeFragments");
  return absl::OkStatus();
}

// The targets whose values come from fragments; no targets if there are none.
CoverageShadingArgs MakeCoverageArgs(RunState& state) {
  CoverageShadingArgs args;
  for (int t = 0; t < state.targets.count; ++t) {
    if (state.plan.targets[size_t(t)].source != ValueSource::kFragments) continue;
    const CudaTarget& target = state.targets.at[t];
    args.targets[args.target_count++] = ShadedTargetOf(target, AccumulatorsOf(state, t));
    args.traits |= TraitsOf(target.shader);
  }
  args.grid = state.view;
  args.by_words_per_row = MakeDivisor(uint32_t(state.view.words_per_row));
  args.by_ny = MakeDivisor(uint32_t(state.view.dims[1]));
  args.mesh = state.mesh.view.data();
  args.ranks = RanksOf(state);
  if (!state.lists.touched_bits.empty()) args.coverage = state.coverage.data();
  return args;
}

absl::Status Launch(RunState& state, const CoverageShadingArgs& args) {
  if (args.target_count == 0 || args.count == 0) return absl::OkStatus();
  const unsigned blocks = BlocksFor(args.count, kShadeThreads, uint64_t(state.device.multiprocessors) * 32);
  constexpr size_t kShared = kShadeThreads * sizeof(TriangleInput);
  static_assert(kShared <= 46 << 10);  // more needs an opt-in
  ShadeCoverage<<<blocks, kShadeThreads, kShared, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ShadeCoverage");
  return absl::OkStatus();
}

}  // namespace

absl::Status ShadeList(RunState& state, int index, const FragmentList& list, uint8_t* out) {
  ListArgs args = MakeListArgs(state, list, index, index + 1);
  args.out[0] = out;
  return Launch(state, args);
}

absl::Status ShadeList(RunState& state, const FragmentList& list, uint8_t* const (&out)[kMaxTargets]) {
  ListArgs args = MakeListArgs(state, list, 0, state.targets.count);
  std::copy(std::begin(out), std::end(out), args.out);
  return Launch(state, args);
}

absl::Status FindKept(RunState& state, const FragmentList& list, uint8_t* kept) {
  const ListArgs args = MakeListArgs(state, list, 0, state.targets.count);
  MarkKept<<<BlocksFor(list.count, kShadeThreads), kShadeThreads, 0, state.stream>>>(args, kept);
  VOXELPIPE_LAUNCHED_OR_RETURN("MarkKept");
  return absl::OkStatus();
}

absl::Status ShadeRecords(RunState& state) {
  CoverageShadingArgs args = MakeCoverageArgs(state);
  args.records = state.lists.cells.data();
  args.blocks = state.lists.blocks.data();
  args.placed = PlacedTriangles(state);
  args.count = state.mesh.host_view.triangle_count;
  return Launch(state, args);
}

absl::Status ShadeSpans(RunState& state, const ListedSpans& listed) {
  CoverageShadingArgs args = MakeCoverageArgs(state);
  args.spans = state.lists.spans.data();
  args.count = listed.count;
  args.first_triangle = listed.first_triangle;
  return Launch(state, args);
}

}  // namespace voxelpipe::cuda
