// Part of measure.cpp: the voxels that a fill adds, from some lines along x.
#pragma once

#include "base/job_context.h"
#include "grid/grid_spec.h"
#include "host_mesh/measure_cells.h"
#include "job/request.h"
#include "mesh/views/mesh_view.h"
#include "pipeline/plan/surface.h"

namespace voxelpipe {

// True if the shell of a flood fill differs from the coverage.
inline bool HasSeparateShell(const VoxelizeRequest& request) {
  return request.fill == Fill::kFlood && request.coverage != Coverage::kConservative;
}

// In: a request with a fill; the voxels of the shell of a flood; the cells of the grid; the surface but for its inside.
// Sets `inside` and `filled_bricks`. The caller checks the job.
void CountFilled(const MeshView& mesh, const VoxelizeRequest& request, const GridSpec& grid, const JobContext& job,
                 double shell, const Cells& cells, Surface& out);

}  // namespace voxelpipe
