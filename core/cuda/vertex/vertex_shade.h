// Interface between the files of vertex shading on the device.
#pragma once

#include <optional>

#include "absl/status/statusor.h"
#include "cuda/run/run_state.h"
#include "cuda/vertex/vertex_args.h"
#include "host_mesh/vertex_shade.h"

namespace voxelpipe::cuda {

// Device memory of a pose that is not cached with the mesh. Must live until the kernels that read it are launched.
struct DevicePose {
  DeviceArray<uint8_t> rest, pose;
};

// Uploads the mesh's primitives, unless cached, and the pose; sets the pose members of `args`. `posed` must have parts.
absl::Status UploadPose(RunState& state, const PosedMesh& posed, DevicePose& memory, VertexArgs& args);

// Orders the uploaded triangles of state.mesh by parts, as the uploaded runs number them (PartState).
absl::Status OrderTriangles(RunState& state);

// Launches the shader for all vertices.
absl::Status RunVertexShader(const RunState& state, VertexShaderId shader, const VertexArgs& args);

// True if the plan depends on the sums of MeshExtent, not only on the grid.
bool WantsSums(const VoxelizeRequest& request);

// Measures the mesh in state.mesh.host_view, which must have triangles. `held_bytes` stays 0; sums are computed only if
// the plan needs them. nullopt if a triangle has a non-finite vertex. Synchronizes.
absl::StatusOr<std::optional<MeshExtent>> MeasureOnDevice(RunState& state);

}  // namespace voxelpipe::cuda
