// The names of stored meshes.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "load/loader.h"

namespace voxelpipe {

inline constexpr std::string_view kMeshCollection = "meshes/";  // what all of them begin with

// In: the bytes of a mesh file, and the format and the unit that are given with it. Out: the name of the mesh on a
// server: "meshes/" and the SHA-256 of the bytes in lower-case hexadecimal digits; then "-mm", "-cm", "-m" or "-in"
// where a unit is given, then "-obj" and so on where a format is given.
std::string MeshNameOf(std::span<const uint8_t> bytes, const MeshFileType& type);

// INVALID_ARGUMENT naming `field` for a text that MeshNameOf cannot give.
absl::Status CheckMeshName(std::string_view name, std::string_view field);

}  // namespace voxelpipe
