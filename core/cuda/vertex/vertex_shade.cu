// Launches the kernels of vertex shading and measuring.
#include <algorithm>
#include <optional>

#include "cuda/device/launch.cuh"
#include "cuda/vertex/vertex_kernels.cuh"
#include "cuda/vertex/vertex_shade.h"

namespace voxelpipe::cuda {
namespace {

// One kernel per shader, because their register use differs widely.
auto KernelOf(VertexShaderId shader) {
  switch (shader) {
#define VOXELPIPE_CASE(name) \
  case VertexShaderId::k##name: return ShadeVertices<int(VertexShaderId::k##name)>;
    VOXELPIPE_VERTEX_SHADERS(VOXELPIPE_CASE)
#undef VOXELPIPE_CASE
  }
  return ShadeVertices<int(VertexShaderId::kIdentity)>;
}

Vec3d Three(const Surface& s, int first) {
  return {s.number[first], s.number[first + 1], s.number[first + 2]};
}

}  // namespace

absl::Status RunVertexShader(const RunState& state, VertexShaderId shader, const VertexArgs& args) {
  if (args.count == 0) return absl::OkStatus();
  const auto kernel = KernelOf(shader);
  kernel<<<unsigned((args.count + kVertexThreads - 1) / kVertexThreads), kVertexThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ShadeVertices");
  return absl::OkStatus();
}

absl::StatusOr<std::optional<MeshExtent>> MeasureOnDevice(RunState& state) {
  MeasureArgs args;
  args.positions = state.mesh.host_view.positions;
  args.triangles = state.mesh.triangle_list();
  args.count = state.mesh.host_view.triangle_count;
  const unsigned blocks = BlocksFor(args.count, kMeasureThreads, kMaxMeasureBlocks);
  DeviceArray<Surface> surfaces;
  VOXELPIPE_OK_OR_RETURN(surfaces.Resize(kMaxMeasureBlocks + 1, state.stream));
  args.of_blocks = surfaces.data();
  args.window = WindowOf(state.request.request.grid);
  const bool sums = WantsSums(state.request.request);
  const auto kernel = !sums                 ? MeasureTriangles<Sums::kNone>
                      : args.window.known() ? MeasureTriangles<Sums::kInWindow>
                                            : MeasureTriangles<Sums::kWhole>;
  kernel<<<blocks, kMeasureThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("MeasureTriangles");
  Surface* const all = surfaces.data() + kMaxMeasureBlocks;
  JoinSurfaces<<<1, kMaxMeasureBlocks, 0, state.stream>>>(surfaces.data(), int(blocks), all);
  VOXELPIPE_LAUNCHED_OR_RETURN("JoinSurfaces");
  Surface s;
  Vec3d reference;  // of the volume
  const uint32_t first = state.host.view.triangles[0][0];
  VOXELPIPE_CUDA_OR_RETURN(cudaMemcpyAsync(&s, all, sizeof s, cudaMemcpyDeviceToHost, state.stream));
  VOXELPIPE_CUDA_OR_RETURN(
      cudaMemcpyAsync(&reference, args.positions + first, sizeof reference, cudaMemcpyDeviceToHost, state.stream));
  VOXELPIPE_CUDA_OR_RETURN(cudaStreamSynchronize(state.stream));
  if (s.number[Surface::kBad] != 0) return std::optional<MeshExtent>();
  MeshExtent extent;
  extent.box = {Three(s, Surface::kMin), Three(s, Surface::kMax), false};
  for (int a = 0; a < 3; ++a) {  // normalizes -0 to +0
    extent.box.min[a] += 0.0;
    extent.box.max[a] += 0.0;
  }
  extent.triangles_outside = uint64_t(s.number[Surface::kOutside]);
  if (!sums) return std::optional(extent);
  SurfaceSums made;
  made.triangles = s.number[Surface::kTriangles];
  made.area = Three(s, Surface::kArea);
  made.dominant = Three(s, Surface::kDominant);
  made.width = Three(s, Surface::kWidth);
  // Moves the volume's reference point to the box's centre, which was not known before.
  const Vec3d centre = (extent.box.min + extent.box.max) * 0.5;
  made.volume = s.number[Surface::kVolume] - Dot(centre - reference, Three(s, Surface::kNormal)) / 6;
  extent.sums = made;
  return std::optional(extent);
}

}  // namespace voxelpipe::cuda
