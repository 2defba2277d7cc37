// Flattening for a job that may be cancelled.
#pragma once

#include "base/job_context.h"
#include "mesh/flatten.h"

namespace voxelpipe {

// Flatten (flatten.h) that returns CANCELLED or DEADLINE_EXCEEDED soon after the job ended.
absl::StatusOr<TriangleMesh> FlattenFor(const JobContext& job, const Scene& scene, const LoadLimits& limits);

}  // namespace voxelpipe
