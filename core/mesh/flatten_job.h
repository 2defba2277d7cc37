// Flattening on behalf of a job that may end.
#pragma once

#include "base/job_context.h"
#include "mesh/flatten.h"

namespace voxelpipe {

// Flatten (flatten.h) that ends soon after the job: then CANCELLED or DEADLINE_EXCEEDED.
absl::StatusOr<TriangleMesh> FlattenFor(const JobContext& job, const Scene& scene, const LoadLimits& limits);

}  // namespace voxelpipe
