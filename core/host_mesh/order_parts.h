// The triangles of a mesh in the order in which its parts own voxels.
#pragma once

#include "host_mesh/host_mesh.h"

namespace voxelpipe {

// For a request whose parts are filled (FillsParts): orders the view's runs by the rank of their part, then by triangle
// id, and its triangles with them, so that of the triangles of a voxel the last one is the owner's. The view's triangle
// numbers are then no ids: PartView::id_offset leads to these. Errors: RESOURCE_EXHAUSTED, the job's.
absl::Status OrderByParts(HostMesh& mesh);

}  // namespace voxelpipe
