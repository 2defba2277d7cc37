// What PlaceMeshes joins beside the arrays of vertices and triangles.
#pragma once

#include <span>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "mesh/placed_mesh.h"

namespace voxelpipe {

// The matrix of an entry with 0 in place of -0, as it comes from a server: equal matrices give equal bytes.
inline Mat4d MatrixOf(const PlacedMesh& placed) {
  Mat4d matrix = placed.matrix;
  for (auto& row : matrix.m) {
    for (double& number : row) number += 0.0;
  }
  return matrix;
}

// Lists every vertex attribute of the meshes once, with the components of the widest, and copies their values. Charged
// to mesh.memory. Errors: RESOURCE_EXHAUSTED, the job's. May throw bad_alloc.
absl::Status JoinAttributes(const JobContext& job, std::span<const PlacedMesh> meshes, TriangleMesh& mesh);

// Sets mesh.rig if every mesh has one; a mesh that is not placed by the identity gets a root node with its matrix.
// Charged and failing like JoinAttributes.
absl::Status JoinRigs(const JobContext& job, std::span<const PlacedMesh> meshes, TriangleMesh& mesh);

}  // namespace voxelpipe
