// A mesh for the posing shaders: a skinned part, a morphed one with several instances, and a static one.
#pragma once

#include <cstdint>

#include "mesh/triangle_mesh.h"

namespace voxelpipe::gpu {

// Coordinates about [0, 40]. Two animations of two seconds: all paths and interpolations; the second one moves joints
// alone. Normals and tangents on all parts but the last.
TriangleMesh RiggedMesh(uint32_t seed);

}  // namespace voxelpipe::gpu
