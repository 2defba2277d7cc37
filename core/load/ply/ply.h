// PLY, ASCII and binary of both byte orders -> Scene.
// Source: G. Turk, "The PLY Polygon File Format" (Stanford University, 1994).
#pragma once

#include <cstdint>
#include <span>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/scene/load_limits.h"
#include "mesh/scene/scene.h"

namespace voxelpipe {

// In: a whole file. Out: one primitive. Polygons become triangles (base/polygons.h), in file order,
// strips of the element tristrips too (-1 ends a strip). Of the vertices: x y z, in double if their type is; nx ny nz;
// red green blue alpha (integers as fractions of their largest value, floats from 0 to 1, both sRGB as programs write
// them, converted to linear); u v or s t (their origin is at the bottom, that of TEXCOORD_0 at the top); each other
// scalar property NAME is the attribute _NAME. Other elements, colours of faces and textures are ignored with a
// warning. Every count is checked against the bytes that follow before memory is allocated. Errors: INVALID_ARGUMENT
// naming line, vertex or face; RESOURCE_EXHAUSTED naming the limit; the job's, which is polled between elements.
absl::StatusOr<Scene> LoadPly(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits);

}  // namespace voxelpipe
