// Scene -> TriangleMesh: applies node transforms, instancing and skins in rest pose.
#pragma once

#include "absl/status/statusor.h"
#include "mesh/scene/load_limits.h"
#include "mesh/scene/scene.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// Number of triangles that Flatten would make, after instancing, in O(nodes). Saturates at UINT64_MAX.
uint64_t CountTriangles(const Scene& scene);

// In: a validated scene. Out: its default scene's triangles in world space, in the id order of triangle_mesh.h.
// A skinned mesh ignores its own node's transform; a negative determinant flips the winding (v1 and v2 are swapped).
// Transforms are evaluated in double and positions stay double. The warnings are the scene's, and one if there is no
// triangle. Errors: RESOURCE_EXHAUSTED if the triangles, the vertices or the bytes of application-specific attributes
// exceed `limits`, before they are allocated; INVALID_ARGUMENT naming node, mesh, primitive and vertex if a transformed
// position is not finite.
absl::StatusOr<TriangleMesh> Flatten(const Scene& scene, const LoadLimits& limits = {});

}  // namespace voxelpipe
