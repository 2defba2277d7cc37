// The primitives that Flatten puts into a mesh, and their transforms.
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

// One primitive of one node instance. The part of the mesh with the same index has its position in the mesh.
struct Placement {
  const Primitive* primitive = nullptr;
  const std::vector<Mat4d>* joints = nullptr;  // skinning matrices, or null
  const Mat4d* instance = nullptr;             // of EXT_mesh_gpu_instancing, or null
  Mat4d world;                                 // node and instance transform, unless skinned
  bool mirrored = false;
};

// Sets mesh.rig to the rig of the placed parts; null if nothing in the scene can take another pose. Copies each
// primitive once. Charged to mesh.memory. Errors: RESOURCE_EXHAUSTED, the job's. May throw bad_alloc.
absl::Status MakeRig(const JobContext& job, const Scene& scene, const std::vector<Placement>& placements,
                     TriangleMesh& mesh);

}  // namespace voxelpipe
