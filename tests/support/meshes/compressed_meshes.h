// Meshes in third-party encodings, made by their own encoders.
#pragma once

#include "support/meshes/glb_builder.h"

namespace voxelpipe::testing {

// A plain .drc file of the shape: positions, and normals if `normals`.
ByteVector DracoFile(const Shape& shape, bool normals = false);

// A GLB of one node, one mesh and one primitive, whose positions and indices are compressed.
ByteVector DracoGlb(const Shape& shape);    // KHR_draco_mesh_compression
ByteVector MeshoptGlb(const Shape& shape);  // EXT_meshopt_compression

// The square of TexturedQuadGlb with a JPEG of width x height texels, a gradient, as its base colour texture.
ByteVector JpegQuadGlb(int width, int height);

}  // namespace voxelpipe::testing
