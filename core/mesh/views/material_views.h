// Materials and textures of a mesh as shaders read them.
#pragma once

#include <vector>

#include "mesh/triangle_mesh.h"
#include "mesh/views/mesh_view.h"

namespace voxelpipe {

struct MaterialViews {
  std::vector<MaterialView> materials;  // those of the mesh, then glTF's default material
  std::vector<TextureView> textures;    // two for each of the mesh: as linear values, as sRGB colours
};

// In: a mesh; images that are not decoded (image.h: PrepareTextures) count as absent. Out: views that point into
// its images.
MaterialViews MakeMaterialViews(const TriangleMesh& mesh);

}  // namespace voxelpipe
