// What the shaded mesh touches of a grid, by a look at each triangle.
#pragma once

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "grid/grid_spec.h"
#include "job/request.h"
#include "mesh/views/mesh_view.h"
#include "pipeline/plan/surface.h"

namespace voxelpipe::cpu {

// In: a mesh with finite positions, whose triangles lie in world space; the grid. Out: the estimate of
// surface.h, each triangle clipped to the grid. What triangles touch on average over all placements in the
// lattice is corrected by an exact count of some triangles, and of some bricks, so that surfaces which lie in each
// other, in one voxel or on the lattice's own planes are seen as what they are. The same for any number of threads, but
// where thousands of triangles touch one of those bricks. Errors: the job's.
absl::StatusOr<Surface> MeasureSurface(const MeshView& mesh, const VoxelizeRequest& request, const GridSpec& grid,
                                       const JobContext& job);

}  // namespace voxelpipe::cpu
