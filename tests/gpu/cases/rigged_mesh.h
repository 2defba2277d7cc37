// A mesh for the shaders that pose: a skinned part, a morphed one that stands there several times, one that does
// neither.
#pragma once

#include <cstdint>

#include "mesh/triangle_mesh.h"

namespace voxelpipe::gpu {

// Coordinates about [0, 40]. Two animations of two seconds: all paths and interpolations; the second one moves joints
// alone. Normals and tangents on all parts but the last.
TriangleMesh RiggedMesh(uint32_t seed);

}  // namespace voxelpipe::gpu
