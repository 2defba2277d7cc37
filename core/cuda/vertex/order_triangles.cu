// Orders the uploaded triangles by parts.
#include "cuda/device/launch.cuh"
#include "cuda/primitives/part_order.h"
#include "cuda/vertex/vertex_shade.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;

__global__ void __launch_bounds__(kThreads)
    GatherTriangles(PartRuns parts, const uint32_t* from, uint64_t triangles, uint32_t* to) {
  const uint64_t step = uint64_t(gridDim.x) * kThreads;
  for (uint64_t t = uint64_t(blockIdx.x) * kThreads + threadIdx.x; t < triangles; t += step) {
    const uint64_t id = uint32_t(t) + parts.Of(t).id_offset;
    for (uint64_t i = 0; i < 3; ++i) to[3 * t + i] = from[3 * id + i];
  }
}

}  // namespace

absl::Status OrderTriangles(RunState& state) {
  MeshView& mesh = state.mesh.host_view;
  if (mesh.triangle_count == 0) return absl::OkStatus();
  DeviceArray<uint32_t>& ordered = state.mesh.by_parts;
  VOXELPIPE_OK_OR_RETURN(ordered.Resize(3 * mesh.triangle_count, state.stream));
  GatherTriangles<<<BlocksFor(mesh.triangle_count, kThreads), kThreads, 0, state.stream>>>(
      PartRuns{mesh.parts, mesh.part_count}, state.mesh.triangle_list(), mesh.triangle_count, ordered.data());
  VOXELPIPE_LAUNCHED_OR_RETURN("GatherTriangles");
  mesh.triangles = reinterpret_cast<const uint32_t(*)[3]>(ordered.data());
  state.mesh.triangles.Free();
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
