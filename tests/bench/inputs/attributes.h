// What the shaders of benchmarks read: normals, texture coordinates and a texture, for generated meshes.
#pragma once

#include "mesh/triangle_mesh.h"

namespace voxelpipe::bench {

struct TextureSize {
  uint32_t edge = 1024;  // texels
  bool masked = false;   // alpha mode MASK, and a quarter of the texels transparent
};

// Gives the mesh unit normals (the mean of each vertex's triangles, by area), texture coordinates by a slanted parallel
// projection onto which the texture is repeated, and one material with a texture of base colours and its mip levels.
void AddAttributes(TriangleMesh& mesh, const TextureSize& texture);

}  // namespace voxelpipe::bench
