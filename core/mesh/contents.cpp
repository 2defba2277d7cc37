#include "mesh/contents.h"

namespace voxelpipe {

MeshContents ContentsOf(const Scene& scene, const TriangleMesh& mesh, uint64_t file_bytes) {
  MeshContents contents;
  contents.format = scene.format;
  contents.unit = scene.unit;
  contents.file_bytes = file_bytes;
  contents.nodes = scene.nodes.size();
  contents.meshes = scene.meshes.size();
  contents.parts = mesh.parts.size();
  contents.materials = scene.materials.size();
  contents.textures = scene.textures.size();
  contents.images = scene.images.size();
  for (const VertexAttribute& attribute : mesh.attributes) {
    contents.attributes.push_back({attribute.name, attribute.components});
  }
  return contents;
}

}  // namespace voxelpipe
