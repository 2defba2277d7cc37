#include "bench/inputs/mesh_files.h"

#include <cstring>

#include "support/meshes/glb_builder.h"

namespace voxelpipe::bench {
namespace {

using nlohmann::json;
using testing::GlbBuilder;

std::vector<Vec3f> SinglePositions(const TriangleMesh& mesh) {
  std::vector<Vec3f> positions;
  positions.reserve(mesh.positions.size());
  for (const Vec3d& p : mesh.positions) positions.push_back({float(p.x), float(p.y), float(p.z)});
  return positions;
}

std::vector<uint32_t> Indices(const TriangleMesh& mesh) {
  std::vector<uint32_t> indices;
  indices.reserve(3 * mesh.triangles.size());
  for (const auto& triangle : mesh.triangles) indices.insert(indices.end(), triangle.begin(), triangle.end());
  return indices;
}

// Adds an accessor of floats to the primitive unless there are none.
template <typename T>
void AddFloats(GlbBuilder& glb, json& primitive, const char* name, const std::vector<T>& values, const char* type) {
  if (values.empty()) return;
  const int view = glb.View(testing::AsBytes(values));
  primitive["attributes"][name] = glb.Accessor(view, testing::kF32, type, values.size());
}

void AddMaterial(GlbBuilder& glb, json& primitive, const TriangleMesh& mesh) {
  if (mesh.images.empty()) return;
  const Image& image = *mesh.images[0];
  const int view = glb.View(testing::MakePng(image.width, image.height, image.rgba));
  glb.doc["images"] = {{{"bufferView", view}, {"mimeType", "image/png"}}};
  glb.doc["textures"] = {{{"source", 0}}};
  json material = {{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}};
  if (mesh.materials.at(0).alpha_mode == AlphaMode::kMask) material["alphaMode"] = "MASK";
  glb.doc["materials"] = {material};
  primitive["material"] = 0;
}

}  // namespace

std::vector<uint8_t> GlbBytes(const TriangleMesh& mesh) {
  GlbBuilder glb;
  json primitive = glb.Primitive(SinglePositions(mesh), Indices(mesh));
  AddFloats(glb, primitive, "NORMAL", mesh.normals, "VEC3");
  AddFloats(glb, primitive, "TEXCOORD_0", mesh.uv[0], "VEC2");
  AddMaterial(glb, primitive, mesh);
  glb.Scene({glb.Node({{"mesh", glb.Mesh(std::move(primitive))}})});
  return glb.Glb();
}

std::vector<uint8_t> StlBytes(const TriangleMesh& mesh) {
  constexpr size_t kHeader = 84, kTriangle = 50;
  std::vector<uint8_t> bytes(kHeader + kTriangle * mesh.triangles.size());
  const auto count = uint32_t(mesh.triangles.size());
  std::memcpy(bytes.data() + 80, &count, 4);
  uint8_t* at = bytes.data() + kHeader;
  for (const auto& triangle : mesh.triangles) {
    float numbers[12] = {};  // a normal of zeros: readers make their own
    for (size_t corner = 0; corner < 3; ++corner) {
      const Vec3d& p = mesh.positions[triangle[corner]];
      for (int a = 0; a < 3; ++a) numbers[3 + 3 * corner + size_t(a)] = float(p[a]);
    }
    std::memcpy(at, numbers, sizeof numbers);
    at += kTriangle;
  }
  return bytes;
}

}  // namespace voxelpipe::bench
