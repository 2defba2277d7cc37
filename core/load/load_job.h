// Loading on behalf of a job that may end.
#pragma once

#include "base/job_context.h"
#include "load/loader.h"

namespace voxelpipe {

// LoadScene (loader.h) that ends soon after the job: then CANCELLED or DEADLINE_EXCEEDED. The job is polled within
// each step, but for the connectivity and a group of attributes of a Draco stream, and a compressed buffer view, which
// are decoded in one go. What the scene takes is charged to MemoryOf(job), which must outlive it.
absl::StatusOr<Scene> LoadSceneFor(const JobContext& job, std::span<const uint8_t> bytes,
                                   MeshFormat format = MeshFormat::kAuto, const LoadLimits& limits = {});

}  // namespace voxelpipe
