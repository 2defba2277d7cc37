// OBJ with its material libraries -> Scene.
// Sources: Wavefront Technologies, "Advanced Visualizer Manual" (1995), appendix B1, "Object Files (.obj)"; D. Ramey,
// L. Rose, L. Tyerman, "MTL material format" (1995).
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/scene/load_limits.h"
#include "mesh/scene/scene.h"

namespace voxelpipe {

// True if the first statement of the text, but for groups and names, is one of OBJ that is read. The job is polled; the
// answer is of no use once it is over.
bool IsObj(const JobContext& job, std::string_view text);

// In: a whole file whose material libraries and textures are data: URIs (load/pack_obj.h makes them); other names
// are never opened, and give a warning. Out: one mesh. Polygons become triangles (base/polygons.h) in file order;
// each change of material begins a primitive. A material that no library has is a default one of its own. Colours of
// vertices ("v x y z r g b", from 0 to 1) and of materials are sRGB, as programs write them, and are converted to
// linear. v of texture coordinates points up, that of TEXCOORD_0 down. Points, lines and groups are ignored, free-form
// geometry with a warning.
// Errors: INVALID_ARGUMENT naming the line; RESOURCE_EXHAUSTED naming the limit; the job's, which is polled within
// the text.
absl::StatusOr<Scene> LoadObj(const JobContext& job, std::span<const uint8_t> bytes, const LoadLimits& limits);

}  // namespace voxelpipe
