// Vertex shading on the host, whole and in its steps, for a backend that runs the shader elsewhere.
#pragma once

#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "host_mesh/host_mesh.h"
#include "mesh/scene/pose.h"

namespace voxelpipe {

// Sets mesh.view, and the lists that it refers to, to the mesh before the vertex shader. Once a run.
void MakeViews(HostMesh& mesh);

// The parts of the mesh in the pose of `morph` or `skin`; views point into the members and the mesh.
struct PosedMesh {
  std::unique_ptr<Pose> pose, later;
  std::vector<std::vector<MorphTargetView>> targets;  // of each part
  std::vector<PosedPartView> parts;                   // empty: the file's own pose; otherwise one a part of the mesh
  MemoryCharge memory;                                // of targets and parts, and of a copy for a device
};
// INVALID_ARGUMENT naming the shader for a pose that the file does not support; RESOURCE_EXHAUSTED; the job's errors.
absl::StatusOr<PosedMesh> MakePose(const HostMesh& mesh);

// What the vertex shader writes.
struct VertexWork {
  bool places = false;  // positions, normals, tangents
  bool moves = false;   // velocities
  bool any() const { return places || moves; }
};
VertexWork WorkOf(const HostMesh& mesh, const PosedMesh& posed);

// Runs the vertex shader on the host; mesh.view then refers to its output.
absl::Status ShadeVertices(HostMesh& mesh);

// The extent of the mesh in mesh.view. INVALID_ARGUMENT naming the first vertex of a triangle that is not finite; the
// job's errors.
absl::StatusOr<MeshExtent> MeasureMesh(const HostMesh& mesh);

// All of it: mesh.view shows the shaded mesh. Out: its extent. Errors: those of MakePose and MeasureMesh.
absl::StatusOr<MeshExtent> ShadeHostMesh(HostMesh& mesh);

}  // namespace voxelpipe
