#include "mesh/report.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <vector>

#include "base/memory_budget.h"
#include "mesh/weld.h"

namespace voxelpipe {
namespace {

// `memory` may be null.
absl::StatusOr<uint64_t> CountOpenEdgesFor(const JobContext& job, MemoryBudget* memory, const TriangleMesh& mesh) {
  MemoryCharge charge(memory);
  const uint64_t bytes = mesh.positions.size() * kWeldBytes + mesh.triangles.size() * 3 * sizeof(uint64_t);
  if (absl::Status full = charge.Grow(bytes, "looking for open edges"); !full.ok()) return full;
  if (absl::Status over = job.Check(); !over.ok()) return over;
  const std::vector<uint32_t> id = Weld(mesh.positions).id;
  if (absl::Status over = job.Check(); !over.ok()) return over;
  constexpr uint64_t kNoEdge = UINT64_MAX;
  std::vector<uint64_t> edges(mesh.triangles.size() * 3);
  tbb::parallel_for(size_t{0}, mesh.triangles.size(), [&](size_t t) {
    for (int i = 0; i < 3; ++i) {
      const uint64_t a = id[mesh.triangles[t][i]], b = id[mesh.triangles[t][(i + 1) % 3]];
      edges[t * 3 + i] = a == b ? kNoEdge : a < b ? a << 32 | b : b << 32 | a;
    }
  });
  if (absl::Status over = job.Check(); !over.ok()) return over;
  tbb::parallel_sort(edges.begin(), edges.end());
  if (absl::Status over = job.Check(); !over.ok()) return over;
  uint64_t open = 0;
  for (size_t begin = 0; begin < edges.size() && edges[begin] != kNoEdge;) {
    size_t end = begin + 1;
    while (end < edges.size() && edges[end] == edges[begin]) ++end;
    open += (end - begin) % 2;
    begin = end;
  }
  return open;
}

absl::StatusOr<MeshReport> Report(const JobContext& job, MemoryBudget* memory, const TriangleMesh& mesh) {
  const absl::StatusOr<uint64_t> open_edges = CountOpenEdgesFor(job, memory, mesh);
  if (!open_edges.ok()) return open_edges.status();
  MeshReport report = BoxReport(mesh);
  report.open_edges = *open_edges;
  report.degenerate_triangles = CountDegenerateTriangles(mesh);
  return report;
}

}  // namespace

uint64_t CountOpenEdges(const TriangleMesh& mesh) {
  const JobContext endless;
  return *CountOpenEdgesFor(endless, nullptr, mesh);
}

uint64_t CountDegenerateTriangles(const TriangleMesh& mesh) {
  uint64_t count = 0;
  for (const auto& t : mesh.triangles) {
    const Vec3d& a = mesh.positions[t[0]];
    const Vec3d n = Cross(mesh.positions[t[1]] - a, mesh.positions[t[2]] - a);
    count += n.x == 0 && n.y == 0 && n.z == 0;
  }
  return count;
}

MeshReport ReportMesh(const TriangleMesh& mesh) {
  const JobContext endless;
  return *Report(endless, nullptr, mesh);
}

absl::StatusOr<MeshReport> ReportMeshFor(const JobContext& job, const TriangleMesh& mesh) {
  return Report(job, &MemoryOf(job), mesh);
}

MeshReport BoxReport(const TriangleMesh& mesh) {
  MeshReport report;
  report.triangles = mesh.triangles.size();
  report.vertices = mesh.positions.size();
  bool first = true;
  for (const auto& triangle : mesh.triangles) {
    for (const uint32_t vertex : triangle) {
      const Vec3d& p = mesh.positions[vertex];
      for (int a = 0; a < 3; ++a) {
        report.min[a] = first ? p[a] : Min(report.min[a], p[a]);
        report.max[a] = first ? p[a] : Max(report.max[a], p[a]);
      }
      first = false;
    }
  }
  return report;
}

}  // namespace voxelpipe
