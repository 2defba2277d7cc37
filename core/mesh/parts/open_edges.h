// Which parts of a mesh bound no solid.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/parts/part_list.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// In: a mesh and its parts, cut by `scope`. Out: of each part the number of edges that an odd number of its triangles
// uses, after welding equal positions (-0 = +0); an edge between two equal positions is none. A part without such edges
// is closed. O(n) expected time; of placed meshes whose edges are known, O(parts). Errors: RESOURCE_EXHAUSTED, the job's.
absl::StatusOr<std::vector<uint64_t>> CountOpenEdges(const JobContext& job, const TriangleMesh& mesh,
                                                     const PartList& list, PartScope scope);

}  // namespace voxelpipe
