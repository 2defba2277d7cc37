// The names of stored meshes.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "mesh/scene/length_unit.h"

namespace voxelpipe {

// In: the bytes of a mesh file, and the unit that is given with it. Out: the id of the mesh on a server, 64 lower-case
// hexadecimal digits: the SHA-256 of the bytes; with a unit, the SHA-256 of those digits, a colon and the unit's name.
std::string MeshIdOf(std::span<const uint8_t> bytes, LengthUnit unit);

}  // namespace voxelpipe
