// 3MF packages -> Scene.
#pragma once

#include <cstdint>
#include <span>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/scene/load_limits.h"
#include "mesh/scene/scene.h"

namespace voxelpipe {

// In: a whole package (a ZIP archive). Out: the objects of the build, placed by its items and their components, in
// metres: the root node scales the model's unit (millimetres by default). Axes stay those of the file (3MF: z up).
// Base materials become materials, colours of a colour group and of base materials are sRGB and converted to linear,
// texture groups become texture coordinates and a material each. A change of these within an object begins a primitive,
// so that triangles keep their order. Other properties and extensions (beam lattices, slices) are ignored with a
// warning. The production extension's parts are read. Parts that slicers cut away give a
// warning each. Errors: INVALID_ARGUMENT naming entry and line;
// RESOURCE_EXHAUSTED naming the limit; the job's.
absl::StatusOr<Scene> Load3mf(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits);

}  // namespace voxelpipe
