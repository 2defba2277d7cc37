// One run of a case through the public entry points.
#pragma once

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "gpu/cases/parity_cases.h"
#include "gpu/parity/first_difference.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe::gpu {

// The result of the case's request for the mesh: streamed or in memory, with the case's slab depth. Errors: the run's.
absl::StatusOr<Delivered> Run(const TriangleMesh& mesh, const ParityCase& c, const JobContext& job = {});

}  // namespace voxelpipe::gpu
