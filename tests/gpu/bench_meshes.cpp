#include "gpu/bench_meshes.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include "bench/meshes.h"
#include "load/image.h"
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

}  // namespace

TriangleMesh LoadMeshOrExit(const std::string& path) {
  absl::StatusOr<std::vector<uint8_t>> bytes = ReadAndPackMeshFile(path);
  absl::StatusOr<Scene> scene = bytes.ok() ? LoadScene(*bytes) : bytes.status();
  absl::StatusOr<TriangleMesh> mesh = scene.ok() ? Flatten(*scene) : scene.status();
  const absl::Status status = mesh.ok() ? PrepareTextures(*mesh) : mesh.status();
  if (!status.ok()) {
    std::fprintf(stderr, "%s: %s\n", path.c_str(), status.ToString().c_str());
    std::exit(1);
  }
  return *std::move(mesh);
}

std::vector<BenchMesh> BenchMeshes(const std::string& bunny, const std::string& cow) {
  const auto of = [](const std::string& path, int64_t triangles) -> std::function<TriangleMesh()> {
    if (path.empty()) return [triangles] { return bench::BumpySphere(triangles); };
    return [path] { return InUnitCube(LoadMeshOrExit(path)); };
  };
  const auto what = [](const std::string& path, const char* count) {
    return path.empty() ? std::string("generated sphere of ") + count : path.substr(path.rfind('/') + 1);
  };
  const auto full = of(bunny, 69'451);
  const std::string name = what(bunny, "69 k triangles");
  return {{"cow", what(cow, "5.8 k triangles"), of(cow, 5'804)},
          {"bunny", name, full},
          {"bunny1M", name + ", every triangle in 16, jittered", [=] { return bench::Subdivided(full(), 2); }},
          {"sphere10M", "generated sphere with bumps", [] { return bench::BumpySphere(10'000'000); }},
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
