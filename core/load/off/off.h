// OFF (Object File Format), text -> Scene.
// Source: The Geometry Center, "Geomview 1.9 manual" (2014), section "OFF Files".
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/scene/load_limits.h"
#include "mesh/scene/scene.h"

namespace voxelpipe {

// True if the text begins, behind comments, with the keyword: OFF behind any of ST, C and N, or a variant that LoadOff
// refuses by name. The job is polled; the answer is of no use once it is over.
bool IsOff(const JobContext& job, std::string_view text);

// In: a whole file; the keyword may be missing. Out: one primitive. A vertex is a line: x y z, then the normal if the
// keyword has N, then a colour if it has C, then u v if it has ST; in files that do not fit this, lines may end
// anywhere in the head and the vertices, and a colour has four numbers. Positions are read in double. Colours are from
// 0 to 1 if one of their numbers has a point or an exponent and none is above 1, otherwise from 0 to 255; sRGB, made
// linear. v points up, that of TEXCOORD_0 down. Polygons become triangles (base/polygons.h), in file order. Colours of
// faces are ignored with a warning. Errors: INVALID_ARGUMENT naming the line; RESOURCE_EXHAUSTED naming the limit; the
// job's, which is polled within the text.
absl::StatusOr<Scene> LoadOff(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits);

}  // namespace voxelpipe
