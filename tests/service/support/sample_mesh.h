// Generated mesh files, as a client would send them.
#pragma once

#include <cstdint>
#include <vector>

namespace voxelpipe::testing {

// GLB of a torus with n x n quads (2 n^2 triangles) that has everything a shader can read: normals, texture
// coordinates, vertex colours, a base colour factor and a PNG texture, below a node that turns, scales and mirrors it.
std::vector<uint8_t> TorusGlb(int n);

// GLB of `count` random triangles as large as the unit cube: few bytes, much work.
std::vector<uint8_t> LargeTrianglesGlb(int count);

}  // namespace voxelpipe::testing
