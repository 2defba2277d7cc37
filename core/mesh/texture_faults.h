// What of a mesh's textures cannot be used, and who reads it.
#pragma once

#include <vector>

#include "base/warning.h"
#include "mesh/scene/material.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// Which of mesh.materials some triangle has. O(parts).
std::vector<bool> MaterialsInUse(const TriangleMesh& mesh);

// Which textures shaders that sample `use` sample of a material: alpha masks sample the base colour whatever is in use.
TextureUse TexturesOf(const Material& material, const TextureUse& use);

// A warning for each texture of a material in use that shaders which sample `use` miss: its image has no texels
// (Image::fault: known once PrepareTextures or CheckImages of load/decode/image.h has looked), the reference leads
// nowhere, or a part has no coordinates for it.
void AddTextureWarnings(const TriangleMesh& mesh, const TextureUse& use, WarningList& warnings);

// The same of all materials, in use or not, and of all images, whether a material leads to them or not.
void AddAllTextureWarnings(const TriangleMesh& mesh, WarningList& warnings);

}  // namespace voxelpipe
