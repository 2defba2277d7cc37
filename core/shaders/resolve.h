// What of a bound shader depends on the mesh.
#pragma once

#include "absl/status/status.h"
#include "mesh/triangle_mesh.h"
#include "shaders/catalog.h"

namespace voxelpipe {

// Replaces the names in a fragment shader's text parameters by what they mean in `mesh`.
// INVALID_ARGUMENT for an attribute that the mesh does not have, listing those that it has.
absl::Status ResolveShader(const TriangleMesh& mesh, BoundShader& shader);

}  // namespace voxelpipe
