#include "bench/inputs/attributes.h"

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "load/decode/image.h"

namespace voxelpipe::bench {
namespace {

std::vector<Vec3f> MeanNormals(const TriangleMesh& mesh) {
  std::vector<Vec3d> sums(mesh.positions.size());
  for (const auto& [a, b, c] : mesh.triangles) {
    const Vec3d& p = mesh.positions[a];
    const Vec3d n = Cross(mesh.positions[b] - p, mesh.positions[c] - p);
    for (const uint32_t v : {a, b, c}) sums[v] = sums[v] + n;
  }
  std::vector<Vec3f> normals;
  normals.reserve(sums.size());
  for (const Vec3d& sum : sums) {
    const double length = std::sqrt(Dot(sum, sum));
    const Vec3d n = length > 0 ? sum * (1 / length) : Vec3d{0, 0, 1};
    normals.push_back({float(n.x), float(n.y), float(n.z)});
  }
  return normals;
}

// Blocks of 8x8 texels of one colour each, every texel a little off it; masked, every fourth block is transparent.
std::shared_ptr<Image> MakeImage(const TextureSize& texture) {
  auto image = std::make_shared<Image>();
  image->name = "generated";
  image->width = image->height = texture.edge;
  image->rgba.reserve(size_t{4} * texture.edge * texture.edge);
  for (uint32_t y = 0; y < texture.edge; ++y) {
    for (uint32_t x = 0; x < texture.edge; ++x) {
      const uint32_t block = (x / 8 * 0x9E3779B1u) ^ (y / 8 * 0x85EBCA77u), off = (x * 5 + y * 3) % 16;
      const bool clear = texture.masked && (block >> 28) % 4 == 0;
      image->rgba.insert(image->rgba.end(), {uint8_t((block >> 8) % 240 + off), uint8_t((block >> 16) % 240 + off),
                                             uint8_t((block >> 24) % 240 + off), uint8_t(clear ? 0 : 255)});
    }
  }
  return image;
}

}  // namespace

void AddAttributes(TriangleMesh& mesh, const TextureSize& texture) {
  mesh.normals = MeanNormals(mesh);
  mesh.uv[0].clear();
  for (const Vec3d& p : mesh.positions) mesh.uv[0].push_back({float(p.x + 0.3 * p.z), float(p.y + 0.4 * p.z)});
  Material material;
  material.base_color.texture = 0;
  if (texture.masked) material.alpha_mode = AlphaMode::kMask;
  Texture sampler;
  sampler.image = 0;
  mesh.materials = {material};
  mesh.textures = {sampler};
  mesh.images = {MakeImage(texture)};
  for (MeshPart& part : mesh.parts) {
    part.material = 0;
    part.has_normals = part.has_uv[0] = true;
  }
  TextureUse use;
  use.base_color = true;
  if (const absl::Status s = PrepareTextures(mesh, {}, use); !s.ok()) {
    std::fprintf(stderr, "%s\n", s.ToString().c_str());
    std::abort();  // the limits are far
  }
}

}  // namespace voxelpipe::bench
