// The triangles of a mesh in the order in which its parts own voxels.
#pragma once

#include "host_mesh/host_mesh.h"

namespace voxelpipe {

// For a request whose parts are filled (FillsParts): orders the view's runs by the rank of their part, then by triangle
// id, and numbers their triangles in that order: PartView::first_triangle, and id_offset, which leads to the ids. The
// view's triangles stay where they are. Out: true if they lie in that order already, so that numbers are ids. Errors:
// the job's.
absl::StatusOr<bool> OrderRunsByParts(HostMesh& mesh);

// For a request whose parts are filled (FillsParts): the same, and orders the view's triangles with the runs, so
// that of the triangles of a voxel the last one is the owner's. Errors: RESOURCE_EXHAUSTED, the job's.
absl::Status OrderByParts(HostMesh& mesh);

}  // namespace voxelpipe
