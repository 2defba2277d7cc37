// Resolves the parameters of a bound shader that depend on the mesh.
#pragma once

#include "absl/status/status.h"
#include "mesh/triangle_mesh.h"
#include "shaders/catalog.h"

namespace voxelpipe {

// Resolves the names in a fragment shader's text parameters to indices in `mesh`. INVALID_ARGUMENT for an attribute
// that the mesh does not have, listing those that it has.
absl::Status ResolveShader(const TriangleMesh& mesh, BoundShader& shader);

}  // namespace voxelpipe
