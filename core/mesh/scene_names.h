// The names of a scene's nodes and meshes, which its parts have.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "mesh/scene/scene.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// Sets `names` of the mesh, and the numbers of the scene's meshes and nodes. `order`: the nodes of the scene, parents
// before children. Charged to mesh.memory. Errors: RESOURCE_EXHAUSTED; the job's.
absl::Status SetNames(const JobContext& job, const Scene& scene, const std::vector<uint32_t>& order,
                      TriangleMesh& mesh);

}  // namespace voxelpipe
