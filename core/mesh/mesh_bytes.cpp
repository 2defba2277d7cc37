#include "mesh/mesh_bytes.h"

#include <memory>
#include <set>
#include <vector>

#include "mesh/scene/scene_bytes.h"

namespace voxelpipe {
namespace {

template <typename T>
uint64_t Bytes(const std::vector<T>& values) {
  return values.size() * sizeof(T);
}

uint64_t AnimationsBytes(const std::vector<Animation>& animations) {
  uint64_t bytes = 0;
  for (const Animation& animation : animations) bytes += AnimationBytes(animation);
  return bytes;
}

// Bytes of a rig alone; `morphs` collects the morph data that it shares with the scene.
uint64_t RigBytes(const Rig& rig, std::set<const MorphData*>& morphs) {
  uint64_t bytes = Bytes(rig.nodes) + Bytes(rig.order) + Bytes(rig.parts) + AnimationsBytes(rig.animations);
  for (const RigNode& node : rig.nodes) bytes += Bytes(node.weights);
  for (const Skin& skin : rig.skins) bytes += sizeof skin + Bytes(skin.joints) + Bytes(skin.inverse_bind_matrices);
  std::set<const Primitive*> primitives;  // shared by instances
  for (const RigPart& part : rig.parts) {
    if (!primitives.insert(part.primitive.get()).second) continue;
    const MorphData* const morph = part.primitive->morph.get();
    bytes += sizeof(Primitive) + PrimitiveBytes(*part.primitive) - (morph == nullptr ? 0 : MorphBytes(*morph));
    if (morph != nullptr) morphs.insert(morph);
  }
  return bytes;
}

}  // namespace

uint64_t SceneBytes(const Scene& scene) {
  uint64_t bytes = AnimationsBytes(scene.animations);
  for (const Mesh& mesh : scene.meshes) {
    bytes += Bytes(mesh.weights) + Bytes(mesh.primitives);
    for (const Primitive& p : mesh.primitives) bytes += PrimitiveBytes(p);
  }
  std::set<const Image*> images;  // several may be one
  for (const auto& image : scene.images) {
    if (images.insert(image.get()).second) bytes += Bytes(image->encoded) + Bytes(image->rgba);
  }
  return bytes;
}

uint64_t MeshBytes(const TriangleMesh& mesh) {
  uint64_t bytes = Bytes(mesh.positions) + Bytes(mesh.normals) + Bytes(mesh.tangents) + Bytes(mesh.uv[0]) +
                   Bytes(mesh.uv[1]) + Bytes(mesh.colors) + Bytes(mesh.triangles);
  for (const auto& attribute : mesh.attributes) bytes += Bytes(attribute.values) + Bytes(attribute.runs);
  if (mesh.rig != nullptr) {
    std::set<const MorphData*> morphs;
    bytes += RigBytes(*mesh.rig, morphs);
    for (const MorphData* morph : morphs) bytes += MorphBytes(*morph);
  }
  std::set<const Image*> images;  // several may be one
  for (const auto& image : mesh.images) {
    if (!images.insert(image.get()).second) continue;
    bytes += Bytes(image->encoded) + Bytes(image->rgba) + Bytes(image->linear_mips) + Bytes(image->srgb_mips);
  }
  return bytes;
}

}  // namespace voxelpipe
