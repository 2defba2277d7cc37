// Checks that a mesh from elsewhere is valid: what the pipeline relies on not to access memory out of bounds.
#pragma once

#include "absl/status/status.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// In: any values. OK if all guarantees of triangle_mesh.h, material.h and rig.h for counts, indices and coordinates
// hold; otherwise INVALID_ARGUMENT naming the first violation. O(size of the mesh), on several threads.
absl::Status CheckMesh(const TriangleMesh& mesh);

// For materials, textures and images alone.
absl::Status CheckTextures(const TriangleMesh& mesh);

}  // namespace voxelpipe
