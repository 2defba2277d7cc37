// Loading on behalf of a job that may end.
#pragma once

#include "base/job_context.h"
#include "load/loader.h"

namespace voxelpipe {

// LoadScene (loader.h) that ends soon after the job: then CANCELLED or DEADLINE_EXCEEDED. The job is looked at between the steps of the
// document, its buffers, accessors, images and Draco streams; a single one of these is not interrupted.
absl::StatusOr<Scene> LoadSceneFor(const JobContext& job, std::span<const uint8_t> bytes,
                                   MeshFormat format = MeshFormat::kAuto, const LoadLimits& limits = {});

}  // namespace voxelpipe
