#include "mesh/report.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <numeric>
#include <vector>

#include "base/memory_budget.h"

namespace voxelpipe {
namespace {

bool Before(const Vec3d& a, const Vec3d& b) {
  if (a.x != b.x) return a.x < b.x;
  if (a.y != b.y) return a.y < b.y;
  return a.z < b.z;  // -0 == +0 in every comparison
}

// Per vertex the id of its position; equal positions have the same id.
std::vector<uint32_t> Weld(const std::vector<Vec3d>& positions) {
  std::vector<uint32_t> order(positions.size());
  std::iota(order.begin(), order.end(), 0u);
  tbb::parallel_sort(order.begin(), order.end(),
                     [&](uint32_t a, uint32_t b) { return Before(positions[a], positions[b]); });
  std::vector<uint32_t> id(positions.size());
  uint32_t next = 0;
  for (size_t i = 0; i < order.size(); ++i) {
    if (i > 0 && !(positions[order[i]] == positions[order[i - 1]])) ++next;
    id[order[i]] = next;
  }
  return id;
}

bool IsDegenerate(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  const Vec3d n = Cross(b - a, c - a);
  return n.x == 0 && n.y == 0 && n.z == 0;
}

// `memory` may be null.
absl::StatusOr<uint64_t> CountOpenEdgesFor(const JobContext& job, MemoryBudget* memory, const TriangleMesh& mesh) {
  MemoryCharge charge(memory);
  const uint64_t bytes = mesh.positions.size() * 2 * sizeof(uint32_t) + mesh.triangles.size() * 3 * sizeof(uint64_t);
  if (absl::Status full = charge.Grow(bytes, "looking for open edges"); !full.ok()) return full;
  if (absl::Status over = job.Check(); !over.ok()) return over;
  const std::vector<uint32_t> id = Weld(mesh.positions);
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
  for (const auto& t : mesh.triangles) {
    report.degenerate_triangles += IsDegenerate(mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]);
  }
  return report;
}

}  // namespace

uint64_t CountOpenEdges(const TriangleMesh& mesh) {
  const JobContext endless;
  return *CountOpenEdgesFor(endless, nullptr, mesh);
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
