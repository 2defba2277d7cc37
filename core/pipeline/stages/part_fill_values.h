// What the inside of each part holds.
#pragma once

#include <vector>

#include "grid/grid_spec.h"
#include "mesh/views/mesh_view.h"
#include "pipeline/stages/stages.h"
#include "shaders/fill_value.h"

namespace voxelpipe {

// True if the fill value of the request's target number `index` may differ from part to part (FillsParts): its shader
// reads ids, labels or factors of materials, or it is a velocity and placed meshes have motions of their own.
bool FillsByPart(const BoundRequest& request, size_t index);

// In: a request for which FillsByPart is true, and the mesh with its runs ordered by rank (host_mesh/order_parts.h).
// Out: the value by rank. A part whose triangles do not all give the same output has that of FillValueOf, which is
// `clear`; one whose output is discarded has `clear`.
std::vector<FillValue> PartFillValues(const BoundRequest& request, size_t index, const MeshView& mesh,
                                      const std::vector<RigidMotionNumbers>& motions, const GridSpec& grid);

// The motions of the parts by rank; empty unless the parts are placed meshes and one of them has a motion.
std::vector<RigidMotionNumbers> MotionsByRank(const TriangleMesh& mesh, const BoundRequest& request);

}  // namespace voxelpipe
