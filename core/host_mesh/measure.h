// Estimates the voxels that the shaded mesh touches, from each triangle.
#pragma once

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "grid/grid_spec.h"
#include "job/request.h"
#include "mesh/views/mesh_view.h"
#include "pipeline/plan/surface.h"

namespace voxelpipe {

// In: a mesh with finite positions, whose triangles lie in world space; the grid. Out: the estimate of surface.h, each
// triangle clipped to the grid. The estimate starts from the average over all positions of the grid and is corrected by
// an exact count of some triangles and some bricks, so that coinciding surfaces, several surfaces in one voxel, and
// surfaces in the grid's own planes are counted correctly. The same for any number of threads, unless thousands of
// triangles touch one of those bricks. Errors: the job's.
absl::StatusOr<Surface> MeasureSurface(const MeshView& mesh, const VoxelizeRequest& request, const GridSpec& grid,
                                       const JobContext& job);

// What a plan needs to know of it: of larger meshes from a sample (measure_sample.h), which costs next to nothing
// beside the run. Surface::doubt says how far off lists may be. Of a dense result only what it takes memory for.
absl::StatusOr<Surface> SampleSurface(const MeshView& mesh, const VoxelizeRequest& request, const GridSpec& grid,
                                      const JobContext& job);

}  // namespace voxelpipe
