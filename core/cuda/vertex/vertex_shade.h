// What the parts of vertex shading on the device tell each other.
#pragma once

#include <optional>

#include "absl/status/statusor.h"
#include "cpu/vertex_shade.h"
#include "cuda/run/run_state.h"
#include "cuda/vertex/vertex_args.h"

namespace voxelpipe::cuda {

// Device memory that a pose takes besides what the device keeps of the mesh; must live until the kernels that read it
// are launched.
struct DevicePose {
  DeviceArray<uint8_t> rest, pose;
};

// Uploads the mesh's primitives, unless the device keeps them, and the pose; sets what `args` has of a pose. `posed`
// must have parts.
absl::Status UploadPose(RunState& state, const cpu::PosedMesh& posed, DevicePose& memory, VertexArgs& args);

// Launches the shader over all vertices.
absl::Status RunVertexShader(const RunState& state, VertexShaderId shader, const VertexArgs& args);

// True if the plan follows from more than the grid: the sums of MeshExtent are wanted.
bool WantsSums(const VoxelizeRequest& request);

// The extent of the mesh as state.mesh.host_view shows it, which has triangles; `held_bytes` stays 0. The sums only
// where the plan needs them. Absent where a vertex of a triangle is not finite. Synchronizes.
absl::StatusOr<std::optional<MeshExtent>> MeasureOnDevice(RunState& state);

}  // namespace voxelpipe::cuda
