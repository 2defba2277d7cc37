#include "bench/peers/openvdb_peer.h"

#ifdef VOXELPIPE_OPENVDB
#include <openvdb/openvdb.h>
#include <openvdb/tools/MeshToVolume.h>
#include <tbb/task_arena.h>

#include <chrono>
#include <ctime>

#include "grid/index_space.h"

namespace voxelpipe::bench {
namespace {

// meshToVolume's view of a mesh. Its voxels have their centres at whole numbers, ours half-way between them.
class Adapter {
 public:
  Adapter(const TriangleMesh& mesh, const GridSpec& grid) : triangles_(mesh.triangles) {
    points_.reserve(mesh.positions.size());
    for (const Vec3d& position : mesh.positions) {
      const Vec3d p = WorldToIndex(grid.index_space(), position);
      points_.emplace_back(p.x - 0.5, p.y - 0.5, p.z - 0.5);
    }
  }
  size_t polygonCount() const { return triangles_.size(); }
  size_t pointCount() const { return points_.size(); }
  size_t vertexCount(size_t) const { return 3; }
  void getIndexSpacePoint(size_t polygon, size_t vertex, openvdb::Vec3d& point) const {
    point = points_[triangles_[polygon][vertex]];
  }

 private:
  const std::vector<std::array<uint32_t, 3>>& triangles_;
  std::vector<openvdb::Vec3d> points_;
};

double ProcessCpuMs() {
  timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return double(t.tv_sec) * 1e3 + double(t.tv_nsec) * 1e-6;
}

}  // namespace

std::optional<PeerRun> RunOpenVdb(const TriangleMesh& mesh, const GridSpec& grid, int threads) {
  openvdb::initialize();
  const Adapter adapter(mesh, grid);
  const openvdb::math::Transform::Ptr transform = openvdb::math::Transform::createLinearTransform(1.0);
  tbb::task_arena arena(threads);
  PeerRun run;
  const auto begin = std::chrono::steady_clock::now();
  const double cpu_begin = ProcessCpuMs();
  const openvdb::FloatGrid::Ptr field = arena.execute([&] {
    return openvdb::tools::meshToVolume<openvdb::FloatGrid>(adapter, *transform, 1.0f, 1.0f,
                                                            openvdb::tools::UNSIGNED_DISTANCE_FIELD);
  });
  run.cpu_ms = ProcessCpuMs() - cpu_begin;
  run.wall_ms = std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
  run.voxels = field->activeVoxelCount();
  return run;
}

}  // namespace voxelpipe::bench

#else

namespace voxelpipe::bench {

std::optional<PeerRun> RunOpenVdb(const TriangleMesh&, const GridSpec&, int) {
  return std::nullopt;
}

}  // namespace voxelpipe::bench

#endif
