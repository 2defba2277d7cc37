// The steps of vertex shading, for a backend that runs the shader elsewhere.
#pragma once

#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "cpu/run_state.h"
#include "mesh/scene/pose.h"

namespace voxelpipe::cpu {

// Sets state.view, and the lists that it refers to, to the mesh before the vertex shader. Once a run.
void MakeViews(RunState& state);

// The parts of the mesh in the pose of `morph` or `skin`; views point into the members and the mesh.
struct PosedMesh {
  std::unique_ptr<Pose> pose, later;
  std::vector<std::vector<MorphTargetView>> targets;  // of each part
  std::vector<PosedPartView> parts;                   // empty: the file's own pose; otherwise one a part of the mesh
  MemoryCharge memory;                                // of targets and parts, and of a copy for a device
};
// INVALID_ARGUMENT naming the shader for a pose that the file does not support; RESOURCE_EXHAUSTED; the job's errors.
absl::StatusOr<PosedMesh> MakePose(const RunState& state);

// What the vertex shader writes.
struct VertexWork {
  bool places = false;  // positions, normals, tangents
  bool moves = false;   // velocities
  bool any() const { return places || moves; }
};
VertexWork WorkOf(const RunState& state, const PosedMesh& posed);

// Runs the vertex shader on the host; state.view then refers to its output.
absl::Status ShadeVertices(RunState& state);

// The extent of the mesh in state.view. INVALID_ARGUMENT naming the first vertex of a triangle that is not finite.
absl::StatusOr<MeshExtent> MeasureMesh(const RunState& state);

}  // namespace voxelpipe::cpu
