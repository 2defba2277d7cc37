// glTF 2.0 JSON plus an optional binary chunk -> Scene.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/scene/load_limits.h"
#include "mesh/scene/scene.h"

namespace voxelpipe {

// In: the JSON text and, for GLB, the BIN chunk (empty span and no value differ: a GLB without BIN has none);
// `warnings` so far, which become the first of the scene. Errors: see LoadScene; those of the job, which is polled
// between the steps.
absl::StatusOr<Scene> LoadGltf(const JobContext& job, std::string_view json,
                               std::optional<std::span<const uint8_t>> binary_chunk, const LoadLimits& limits,
                               WarningList warnings);

}  // namespace voxelpipe
