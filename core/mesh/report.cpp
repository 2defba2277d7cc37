#include "mesh/report.h"

#include <algorithm>
#include <atomic>
#include <vector>

#include "base/long_loops.h"
#include "base/memory_budget.h"
#include "base/parallel.h"
#include "mesh/weld.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kNoEdge = UINT64_MAX;

// The edges of all triangles, three each: the ids of their ends, the smaller one first, or kNoEdge.
absl::StatusOr<std::vector<uint64_t>> ListEdges(const JobContext& job, const TriangleMesh& mesh) {
  const absl::StatusOr<WeldedVertices> welded = Weld(job, mesh.positions);
  if (!welded.ok()) return welded.status();
  const std::vector<uint32_t>& id = welded->id;
  std::vector<uint64_t> edges;
  if (absl::Status over = Resize(job, edges, mesh.triangles.size() * 3); !over.ok()) return over;
  absl::Status over =
      ParallelChunks(int64_t(mesh.triangles.size()), int64_t(kElementsAStep), job, [&](int64_t begin, int64_t end) {
        for (size_t t = size_t(begin); t < size_t(end); ++t) {
          for (size_t i = 0; i < 3; ++i) {
            const uint64_t a = id[mesh.triangles[t][i]], b = id[mesh.triangles[t][(i + 1) % 3]];
            edges[t * 3 + i] = a == b ? kNoEdge : a < b ? a << 32 | b : b << 32 | a;
          }
        }
      });
  if (!over.ok()) return over;
  return edges;
}

// True if the mesh is known to consist of placed meshes that are closed. To weld one with another adds even numbers.
bool IsOfClosedMeshes(const TriangleMesh& mesh) {
  return !mesh.placed.empty() && std::all_of(mesh.placed.begin(), mesh.placed.end(), [](const PlacedEntry& placed) {
    return placed.open_edges == uint64_t{0};
  });
}

}  // namespace

absl::StatusOr<uint64_t> CountOpenEdges(const JobContext& job, const TriangleMesh& mesh) {
  if (IsOfClosedMeshes(mesh)) return 0;
  MemoryCharge charge(&MemoryOf(job));
  const uint64_t bytes = mesh.positions.size() * kWeldBytes + mesh.triangles.size() * 3 * sizeof(uint64_t);
  if (absl::Status full = charge.Grow(bytes, "looking for open edges"); !full.ok()) return full;
  absl::StatusOr<std::vector<uint64_t>> edges = ListEdges(job, mesh);
  if (!edges.ok()) return edges.status();
  if (absl::Status over = ParallelSort(job, *edges); !over.ok()) return over;
  const std::vector<uint64_t>& sorted = *edges;
  uint64_t open = 0, uses = 0;  // of the edge so far
  absl::Status over = InSteps(job, sorted.size(), [&](uint64_t begin, uint64_t end) {
    for (uint64_t e = begin; e < end && sorted[e] != kNoEdge; ++e) {
      ++uses;
      if (e + 1 < sorted.size() && sorted[e + 1] == sorted[e]) continue;
      open += uses % 2;
      uses = 0;
    }
  });
  if (!over.ok()) return over;
  return open;
}

absl::StatusOr<uint64_t> CountDegenerateTriangles(const JobContext& job, const TriangleMesh& mesh) {
  std::atomic<uint64_t> count{0};
  absl::Status over =
      ParallelChunks(int64_t(mesh.triangles.size()), int64_t(kElementsAStep), job, [&](int64_t begin, int64_t end) {
        uint64_t here = 0;
        for (int64_t i = begin; i < end; ++i) {
          const auto& t = mesh.triangles[size_t(i)];
          const Vec3d& a = mesh.positions[t[0]];
          const Vec3d n = Cross(mesh.positions[t[1]] - a, mesh.positions[t[2]] - a);
          here += n.x == 0 && n.y == 0 && n.z == 0;
        }
        count += here;
      });
  if (!over.ok()) return over;
  return count.load();
}

absl::StatusOr<MeshReport> ReportMesh(const JobContext& job, const TriangleMesh& mesh) {
  const absl::StatusOr<uint64_t> open_edges = CountOpenEdges(job, mesh);
  if (!open_edges.ok()) return open_edges.status();
  const absl::StatusOr<uint64_t> degenerate = CountDegenerateTriangles(job, mesh);
  if (!degenerate.ok()) return degenerate.status();
  absl::StatusOr<MeshReport> report = BoxReport(job, mesh);
  if (!report.ok()) return report;
  report->open_edges = *open_edges;
  report->degenerate_triangles = *degenerate;
  return report;
}

absl::StatusOr<MeshReport> BoxReport(const JobContext& job, const TriangleMesh& mesh) {
  MeshReport report;
  report.triangles = mesh.triangles.size();
  report.vertices = mesh.positions.size();
  bool first = true;
  absl::Status over = InSteps(job, mesh.triangles.size(), [&](uint64_t begin, uint64_t end) {
    for (uint64_t t = begin; t < end; ++t) {
      for (const uint32_t vertex : mesh.triangles[t]) {
        const Vec3d& p = mesh.positions[vertex];
        for (int a = 0; a < 3; ++a) {
          report.min[a] = first ? p[a] : Min(report.min[a], p[a]);
          report.max[a] = first ? p[a] : Max(report.max[a], p[a]);
        }
        first = false;
      }
    }
  });
  if (!over.ok()) return over;
  return report;
}

}  // namespace voxelpipe
