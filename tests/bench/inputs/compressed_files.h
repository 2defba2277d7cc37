// Generated meshes as bytes of files that compress them.
#pragma once

#include <cstdint>
#include <vector>

#include "mesh/triangle_mesh.h"

namespace voxelpipe::bench {

// A GLB with KHR_mesh_quantization and EXT_meshopt_compression, as glTF tools write it: positions of 16 bits,
// octahedral normals of 8 bits behind a filter, indices of 32 bits. In: a mesh with normals (attributes.h).
std::vector<uint8_t> QuantizedGlbBytes(const TriangleMesh& mesh);

// A Draco file of the positions, of 14 bits, and the normals.
std::vector<uint8_t> DracoBytes(const TriangleMesh& mesh);

}  // namespace voxelpipe::bench
