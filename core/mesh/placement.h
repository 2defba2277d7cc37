// What Flatten puts into a mesh, and where.
#pragma once

#include <cstddef>
#include <vector>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "base/vec.h"
#include "mesh/scene/scene.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

inline constexpr size_t kPlacementsAStep = 4096;  // between two polls of the job

// One primitive of one node instance. Where it goes says the part of the mesh with the same index.
struct Placement {
  const Primitive* primitive = nullptr;
  const std::vector<Mat4d>* joints = nullptr;  // skinning matrices, or null
  const Mat4d* instance = nullptr;             // of EXT_mesh_gpu_instancing, or null
  Mat4d world;                                 // node and instance transform, unless skinned
  bool mirrored = false;
};

// The rig of the placed parts into mesh.rig, null where nothing in the scene can take another pose. Copies each
// primitive once. Taken of mesh.memory. Errors: RESOURCE_EXHAUSTED, the job's. May throw bad_alloc.
absl::Status MakeRig(const JobContext& job, const Scene& scene, const std::vector<Placement>& placements,
                     TriangleMesh& mesh);

}  // namespace voxelpipe
