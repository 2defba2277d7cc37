// The formats of mesh files.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

namespace voxelpipe {

enum class MeshFormat { kAuto, kGlb, kGltf, kDraco };

// The format by the first bytes; empty if unknown. Never reads past the end.
std::optional<MeshFormat> SniffMeshFormat(std::span<const uint8_t> bytes);

}  // namespace voxelpipe
