#include "host_mesh/surface_sums.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_reduce.h>

#include "raster/weighed_triangle.h"

namespace voxelpipe {
namespace {

void AddTriangle(const TriangleScale& scale, const Vec3d& centre, const Vec3d& a, const Vec3d& b, const Vec3d& c,
                 SurfaceSums& sums) {
  const WeighedTriangle part = scale.Weigh(a, b, c);
  sums.triangles += part.weight;
  sums.area = sums.area + part.size.area;
  sums.dominant[part.axis] += part.size.area[part.axis];
  sums.width = sums.width + part.size.width;
  sums.volume += Dot(a - centre, Cross(b - a, c - a)) / 6;
}

}  // namespace

SurfaceSums SumSurface(const MeshView& mesh, const GridWindow& window, const Vec3d& centre) {
  constexpr int64_t kGrainOfSums = 1 << 10;
  const TriangleScale scale(window);
  return tbb::parallel_deterministic_reduce(
      tbb::blocked_range<uint64_t>(0, mesh.triangle_count, kGrainOfSums), SurfaceSums(),
      [&](const tbb::blocked_range<uint64_t>& range, SurfaceSums part) {
        for (uint64_t t = range.begin(); t < range.end(); ++t) {
          const uint32_t* const v = mesh.triangles[t];
          AddTriangle(scale, centre, mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]], part);
        }
        return part;
      },
      [](SurfaceSums a, const SurfaceSums& b) {
        a.triangles += b.triangles;
        a.area = a.area + b.area;
        a.dominant = a.dominant + b.dominant;
        a.width = a.width + b.width;
        a.volume += b.volume;
        return a;
      });
}

}  // namespace voxelpipe
