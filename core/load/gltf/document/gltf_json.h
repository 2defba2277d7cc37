// Untrusted JSON text -> the parts of it that the loader reads.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string_view>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/scene/load_limits.h"

namespace voxelpipe::gltf {

// In: the JSON text of a glTF document, already past GuardJson. Out: its tree without the members that the loader does
// not read: `extras` everywhere, and unused members of the document. The tree is charged to `charge` while it grows,
// and the job is polled meanwhile. Errors: INVALID_ARGUMENT naming the byte where the text is no JSON;
// RESOURCE_EXHAUSTED; the job's. May throw bad_alloc.
absl::StatusOr<nlohmann::json> ParseJson(const JobContext& job, std::string_view text, const LoadLimits& limits,
                                         MemoryCharge& charge);

}  // namespace voxelpipe::gltf
