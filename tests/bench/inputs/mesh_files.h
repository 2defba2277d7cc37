// Generated meshes as bytes of files.
#pragma once

#include <cstdint>
#include <vector>

#include "mesh/triangle_mesh.h"

namespace voxelpipe::bench {

// A binary glTF file of one primitive: positions and indices, and normals, texture coordinates and a PNG of the texture
// where the mesh has them (attributes.h).
std::vector<uint8_t> GlbBytes(const TriangleMesh& mesh);

// A binary STL file: positions of every triangle alone.
std::vector<uint8_t> StlBytes(const TriangleMesh& mesh);

}  // namespace voxelpipe::bench
