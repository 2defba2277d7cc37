// The textures of a mesh that cannot be used, and the materials that read them.
#pragma once

#include <vector>

#include "base/warning.h"
#include "mesh/scene/material.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// One flag per material of the mesh: true if a triangle uses it. O(parts).
std::vector<bool> MaterialsInUse(const TriangleMesh& mesh);

// The textures of a material that shaders with `use` sample: alpha masks sample the base colour in addition to `use`.
TextureUse TexturesOf(const Material& material, const TextureUse& use);

// A warning for each texture in `use`, of a material that triangles use, that shaders cannot sample: its image has no
// texels (Image::fault, set by PrepareTextures or CheckImages of load/decode/image.h), the reference is invalid, or a
// part has no coordinates for it.
void AddTextureWarnings(const TriangleMesh& mesh, const TextureUse& use, WarningList& warnings);

// The same for all materials and all images, used or not.
void AddAllTextureWarnings(const TriangleMesh& mesh, WarningList& warnings);

}  // namespace voxelpipe
