// Vertices that no triangle uses.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// In: a mesh whose memory is set and whose indices are valid. Out: the vertices that none of its triangles uses,
// ascending. The list is charged to mesh.memory; the caller must have charged the scratch memory, a byte a vertex,
// there. Errors: RESOURCE_EXHAUSTED. If the job ended, the list is incomplete: the caller checks the job.
absl::StatusOr<std::vector<uint32_t>> UnusedVertices(const JobContext& job, const TriangleMesh& mesh);

}  // namespace voxelpipe
