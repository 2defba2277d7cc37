// What the shaded mesh touches of a grid, from a sample of its triangles.
#pragma once

#include <optional>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "grid/grid_spec.h"
#include "job/request.h"
#include "mesh/views/mesh_view.h"
#include "pipeline/plan/surface.h"

namespace voxelpipe {

inline constexpr double kDoubtOfSample = 1.5;  // Surface::doubt

// MeasureSurface (measure.h) for a sparse or bucketed result, at a small part of its cost: every triangle's box is
// looked at, a sample of a few thousand triangles and all that are much larger than most are measured. Absent where a
// sample has too little to say. The same for any number of threads.
absl::StatusOr<std::optional<Surface>> SampleLists(const MeshView& mesh, const VoxelizeRequest& request,
                                                   const GridSpec& grid, const JobContext& job);

// The same for a dense result, in microseconds but for crossings: what memory is taken for, and fragments as under
// conservative coverage.
absl::StatusOr<Surface> SampleDense(const MeshView& mesh, const VoxelizeRequest& request, const GridSpec& grid,
                                    const JobContext& job);

}  // namespace voxelpipe
