// The entry for untrusted input: GLB, glTF 2.0 JSON, Draco.
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

// In: the whole file. `format` kAuto detects the format. Out: a validated Scene that owns its data. Never touches the
// file system or the network: buffers and images are the GLB chunk or data: URIs only. Errors: INVALID_ARGUMENT naming
// the accessor, buffer view, node, primitive or byte at fault; RESOURCE_EXHAUSTED naming the limit; UNIMPLEMENTED
// never: a required extension that is unknown is INVALID_ARGUMENT naming it.
absl::StatusOr<Scene> LoadScene(std::span<const uint8_t> bytes, MeshFormat format = MeshFormat::kAuto,
                                const LoadLimits& limits = {});

}  // namespace voxelpipe
