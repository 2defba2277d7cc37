// Loading for a job that may be cancelled.
#pragma once

#include "base/job_context.h"
#include "load/loader.h"

namespace voxelpipe {

// LoadScene (loader.h) that returns CANCELLED or DEADLINE_EXCEEDED soon after the job ended. The job is polled within
// each step, except within the connectivity or a group of attributes of a Draco stream and within a compressed buffer
// view. The scene is charged to MemoryOf(job), which must outlive it.
absl::StatusOr<Scene> LoadSceneFor(const JobContext& job, std::span<const uint8_t> bytes, MeshFileType type = {},
                                   const LoadLimits& limits = {});

}  // namespace voxelpipe
