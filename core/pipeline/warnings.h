// The warnings of a request about its mesh and its result.
#pragma once

#include "absl/status/status.h"
#include "base/job_context.h"
#include "base/warning.h"
#include "job/request.h"
#include "job/stats.h"
#include "mesh/triangle_mesh.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe {

// In: a mesh whose textures are prepared (load/decode/image.h). Out: the warnings of the mesh, and of the textures that
// the request's shaders read, and of targets whose values are not what they seem. What is known before the run.
WarningList WarningsOf(const TriangleMesh& mesh, const VoxelizeRequest& request);
// The same, and those of its parts: patterns that match none, and parts that are filled and open.
WarningList WarningsOf(const TriangleMesh& mesh, const BoundRequest& request);

// The warnings of a mesh, whatever is asked of it: all of its textures (CheckImages of
// load/decode/image.h has looked at them).
WarningList AllWarningsOf(const TriangleMesh& mesh);

// Adds what only the run shows of a mesh that has triangles: that alpha masks left nothing, or that the grid that was
// given lies beside it.
void AddRunWarnings(const JobContext& job, const TriangleMesh& mesh, const VoxelizeRequest& request,
                    VoxelizeStats& stats);

// INVALID_ARGUMENT with the first warning's text if the request is strict and there is one.
absl::Status CheckStrict(const VoxelizeRequest& request, const WarningList& warnings);

}  // namespace voxelpipe
