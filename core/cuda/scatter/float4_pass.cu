// Launches the float4 pass and the kernels for the triangles that it defers.
#include "cuda/scatter/float4_pass.h"

#include <algorithm>

#include "cuda/coverage/coverage_pass.h"
#include "cuda/scatter/float4_pass.cuh"
#include "cuda/scatter/store_values.h"
#include "cuda/traversal/raster_args.h"

namespace voxelpipe::cuda {
namespace {

template <bool kThin>
auto KernelFor(bool normals) {
  return normals ? BlendFours<kThin, kNormalShader> : BlendFours<kThin, -1>;
}

// True if all voxels that the mesh touches lie within the slab.
bool LiesWithin(const RunState& state, const GridView& grid) {
  // Voxels: exceeds the conservative widening of narrow triangles plus rounding errors.
  constexpr double kClear = 0x1p-10;
  const Box3d box = BoxInGrid(state);
  const int64_t begin[3] = {0, 0, grid.slab_begin}, end[3] = {grid.dims[0], grid.dims[1], grid.slab_end};
  bool within = true;
  for (int a = 0; a < 3; ++a) {
    within = within && box.min[a] - kClear > double(begin[a]) && box.max[a] + kClear < double(end[a]);
  }
  return within;
}

}  // namespace

bool ShadesByFours(RunState& state, const CudaTarget& target) {
  // Triangles without vertex normals have the same value for both shaders.
  const bool normals =
      target.shader == FragmentShaderId::kNormal || target.shader == FragmentShaderId::kGeometricNormal;
  return normals && state.plan.path == Path::kFloat4 && DegenerateTestOf(state).least_small < DegenerateTest::kNever;
}

absl::Status BlendByFours(RunState& state, const CudaTarget& target, const BlendWriterArgs& args) {
  const uint64_t triangles = state.mesh.host_view.triangle_count;
  VOXELPIPE_OK_OR_RETURN(PrepareQueues(state, args.cover.fragments));
  const RestArgs rest = MakeRestArgs(state, 0, triangles, false);
  FourWalkArgs walk;
  walk.walk = rest.walk;
  walk.walk.rounds =
      RoundsFor(triangles, kFourThreads, uint64_t(state.device.multiprocessors) * kFourBlocks, kMaxFourRounds);
  walk.four.blend = args.blend;
  walk.four.bits = walk.walk.bits;
  walk.four.ny = uint32_t(state.slab_dims[1]);
  walk.four.flip = FlipOf(args.blend);
  for (int a = 0; a < 3; ++a) walk.four.inner[a] = uint32_t(state.slab_dims[a]) - 1;
  walk.four.all_within = LiesWithin(state, walk.walk.grid);
  walk.fragments = args.cover.fragments;
  const uint64_t each = uint64_t(walk.walk.rounds) * kFourThreads;
  const bool normals = ShadesByFours(state, target);
  const auto kernel = walk.walk.coverage == Coverage::kThin ? KernelFor<true>(normals) : KernelFor<false>(normals);
  kernel<<<unsigned((triangles + each - 1) / each), kFourThreads, 0, state.stream>>>(walk);
  VOXELPIPE_LAUNCHED_OR_RETURN("BlendFours");
  const auto emit_waiting = normals ? EmitWaiting<BlendWriter<kNormalShader, 4>> : EmitWaiting<BlendWriter<-1, 4>>;
  return emit_waiting(state, rest, args);
}

}  // namespace voxelpipe::cuda
