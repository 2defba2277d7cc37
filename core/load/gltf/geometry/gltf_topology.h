// Index lists of glTF's triangle modes -> a plain triangle list.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "load/gltf/document/gltf_buffers.h"

namespace voxelpipe::gltf {

constexpr int kTriangles = 4, kTriangleStrip = 5, kTriangleFan = 6;  // glTF's primitive.mode

// In: one of the three modes; the indices (none = 0, 1, 2, ... below `vertices`), which are checked to be below
// `vertices`. Out: triangles in the order and winding of the glTF 2.0 specification, section 3.7.2.1: in a strip every
// second triangle swaps its last two corners; a fan's triangle i is (i + 1, i + 2, 0). Indices that do not
// complete a triangle are dropped and `incomplete` is set. The triangles are charged to `budget`.
// Errors: INVALID_ARGUMENT saying `where`, the position and the value; RESOURCE_EXHAUSTED past max_triangles; the
// job's.
absl::StatusOr<std::vector<std::array<uint32_t, 3>>> ExpandTriangles(
    int mode, const std::optional<std::vector<uint32_t>>& indices, uint64_t vertices, const std::string& where,
    Budget& budget, bool& incomplete);

// The same checks of triangles that are whole already.
absl::Status CheckTriangles(const std::vector<std::array<uint32_t, 3>>& triangles, uint64_t vertices,
                            const std::string& where, const Budget& budget);

}  // namespace voxelpipe::gltf
