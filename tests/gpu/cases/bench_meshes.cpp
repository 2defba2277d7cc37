#include "gpu/cases/bench_meshes.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>

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

}  // namespace

TriangleMesh LoadMeshOrExit(const std::string& path) {
  absl::StatusOr<FileBytes> bytes = ReadAndPackMeshFile(path);
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
