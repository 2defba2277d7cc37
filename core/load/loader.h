// The entry for untrusted input: GLB, glTF 2.0 JSON, Draco, STL, PLY, OFF, OBJ, 3MF.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "load/decode/mesh_format.h"
#include "mesh/scene/load_limits.h"
#include "mesh/scene/scene.h"

namespace voxelpipe {

// In: the whole file. kAuto detects the format. Out: a validated Scene in metres, or in the file's own numbers if
// neither the file nor `type` has a unit; it owns its data. Never touches the file system or the network: buffers,
// images and material libraries are inside the file or data: URIs. Errors: INVALID_ARGUMENT naming the accessor, buffer
// view, node, primitive, line or byte at fault, or that the format has a unit of its own; RESOURCE_EXHAUSTED naming the
// limit; UNIMPLEMENTED never: a required extension that is unknown is INVALID_ARGUMENT naming it.
absl::StatusOr<Scene> LoadScene(std::span<const uint8_t> bytes, MeshFileType type = {}, const LoadLimits& limits = {});

}  // namespace voxelpipe
