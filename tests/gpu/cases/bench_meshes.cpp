#include "gpu/cases/bench_meshes.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <utility>

#include "bench/meshes.h"
#include "load/decode/image.h"
#include "load/loader.h"
#include "load/pack.h"
#include "mesh/flatten.h"

namespace voxelpipe::gpu {
namespace {

// Moved and scaled so that its box's longest extent is [0, 1] and the others are centred.
TriangleMesh InUnitCube(TriangleMesh mesh) {
  if (mesh.positions.empty()) return mesh;
  Vec3d lo = mesh.positions[0], hi = lo;
  for (const Vec3d& p : mesh.positions) {
    for (int i = 0; i < 3; ++i) {
      lo[i] = std::min(lo[i], p[i]);
      hi[i] = std::max(hi[i], p[i]);
    }
  }
  const Vec3d size = hi - lo;
  const double scale = 1 / std::max({size.x, size.y, size.z});
  const Vec3d by = Vec3d{0.5, 0.5, 0.5} - (lo + hi) * (0.5 * scale);
  for (Vec3d& p : mesh.positions) p = p * scale + by;
  return mesh;
}

// The bumpy sphere with normals, texture coordinates, a texture and the attribute _HEAT. `masked`: a quarter of the
// texture's squares is transparent, and alpha mode MASK discards there.
TriangleMesh ShadedSphere(int64_t triangles, bool masked) {
  constexpr uint32_t kTexels = 1024, kSquare = 16;
  TriangleMesh mesh = bench::BumpySphere(triangles);
  VertexAttribute heat{"_HEAT", 1, {}};
  for (const Vec3d& p : mesh.positions) {
    const Vec3d d = p - Vec3d{0.5, 0.5, 0.5};
    const double length = std::sqrt(Dot(d, d));
    mesh.normals.push_back({float(d.x / length), float(d.y / length), float(d.z / length)});
    mesh.uv[0].push_back({float(0.5 + std::atan2(d.z, d.x) / (2 * M_PI)), float(std::acos(d.y / length) / M_PI)});
    heat.values.push_back(float(273 + 100 * p.y));
  }
  mesh.attributes.push_back(std::move(heat));
  for (MeshPart& part : mesh.parts) part.has_normals = part.has_uv[0] = true, part.material = 0;
  auto image = std::make_shared<Image>();
  image->name = "squares";
  image->width = image->height = kTexels;
  for (uint32_t y = 0; y < kTexels; ++y) {
    for (uint32_t x = 0; x < kTexels; ++x) {
      const bool hole = masked && (x / kSquare) % 2 == 0 && (y / kSquare) % 2 == 0;
      for (const uint32_t v : {x, y, x ^ y, hole ? 0u : 255u}) image->rgba.push_back(uint8_t(v));
    }
  }
  mesh.images = {image};
  mesh.textures = {Texture{.image = 0}};
  Material material;
  material.base_color.texture = 0;
  if (masked) material.alpha_mode = AlphaMode::kMask;
  mesh.materials = {material};
  if (const absl::Status s = PrepareTextures(mesh); !s.ok()) {
    std::fprintf(stderr, "the sphere's texture: %s\n", s.ToString().c_str());
    std::exit(1);
  }
  return mesh;
}

}  // namespace

TriangleMesh LoadMeshOrExit(const std::string& path) {
  const absl::StatusOr<PackedMesh> file = ReadAndPackMeshFile(path);
  absl::StatusOr<Scene> scene = file.ok() ? LoadScene(file->bytes, file->format) : file.status();
  absl::StatusOr<TriangleMesh> mesh = scene.ok() ? Flatten(*scene) : scene.status();
  const absl::Status status = mesh.ok() ? PrepareTextures(*mesh) : mesh.status();
  if (!status.ok()) {
    std::fprintf(stderr, "%s: %s\n", path.c_str(), status.ToString().c_str());
    std::exit(1);
  }
  return *std::move(mesh);
}

std::vector<BenchMesh> BenchMeshes(const std::string& bunny, const std::string& cow) {
  const auto file = [](const std::string& path) { return [path] { return InUnitCube(LoadMeshOrExit(path)); }; };
  const auto base = [](const std::string& path) { return path.substr(path.rfind('/') + 1); };
  std::function<TriangleMesh()> full = [] { return bench::BumpySphere(69'451); };
  std::string name = "generated sphere of 69 k triangles";
  if (!bunny.empty()) full = file(bunny), name = base(bunny);
  std::function<TriangleMesh()> few = [full] { return InUnitCube(bench::Decimated(full(), 5'804)); };
  std::string few_name = name + ", decimated";
  if (!cow.empty()) few = file(cow), few_name = base(cow);
  return {{"cow", few_name, few},
          {"bunny", name, full},
          {"bunny1M", name + ", every triangle in 16, jittered", [=] { return bench::Subdivided(full(), 2); }},
          {"sphere10M", "generated sphere with bumps", [] { return bench::BumpySphere(10'000'000); }},
          {"shaded2M", "generated sphere with normals, texture coordinates, a texture of 1024x1024, an attribute",
           [] { return ShadedSphere(2'000'000, false); }},
          {"shaded2M masked", "the same, a quarter of the texture transparent, alpha mode MASK",
           [] { return ShadedSphere(2'000'000, true); }},
          {"shaded10M", "the sphere of 10 M triangles likewise", [] { return ShadedSphere(10'000'000, false); }},
          {"nasty", "12 tilted planes through the grid, 2 M tiny triangles in 40 clusters, random order",
           [] { return bench::Nasty(); }}};
}

GridRequest UnitCube(int64_t n) {
  GridRequest grid;
  grid.dims = {n, n, n};
  grid.origin = Vec3d{0, 0, 0};
  grid.voxel_size = Vec3d{1, 1, 1} * (1.0 / double(n));
  return grid;
}

}  // namespace voxelpipe::gpu
