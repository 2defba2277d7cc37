// Transforms vertices to index space and encodes the voxels that they touch.
#include "cuda/primitives/voxel_code.h"
#include "cuda/run/run_state.h"
#include "grid/index_space.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;

__global__ void __launch_bounds__(kThreads)
    PlaceKernel(const Vec3d* world, uint64_t count, IndexSpace space, Vec3d* placed, VertexCode* codes) {
  const uint64_t i = uint64_t(blockIdx.x) * kThreads + threadIdx.x;
  if (i >= count) return;
  const Vec3d p = WorldToIndex(space, world[i]);
  placed[i] = p;
  codes[i] = EncodeVertex(p);
}

}  // namespace

absl::Status PlaceVertices(RunState& state) {
  const uint64_t vertices = state.mesh.host_view.vertex_count;
  if (!state.placed && vertices > 0) {
    VOXELPIPE_OK_OR_RETURN(state.mesh.index_positions.Resize(vertices, state.stream));
    VOXELPIPE_OK_OR_RETURN(state.mesh.codes.Resize(vertices, state.stream));
    PlaceKernel<<<unsigned((vertices + kThreads - 1) / kThreads), kThreads, 0, state.stream>>>(
        state.mesh.host_view.positions, vertices, state.grid.index_space(), state.mesh.index_positions.data(),
        state.mesh.codes.data());
    VOXELPIPE_LAUNCHED_OR_RETURN("PlaceKernel");
  }
  state.placed = true;
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
