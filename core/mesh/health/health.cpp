#include "mesh/health/health.h"

#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "base/memory_budget.h"
#include "mesh/health/shells.h"
#include "mesh/report.h"
#include "mesh/weld.h"

namespace voxelpipe {
namespace {

using Corners = std::array<uint32_t, 3>;

absl::StatusOr<uint64_t> CountDuplicateTriangles(const JobContext& job, const TriangleMesh& mesh,
                                                 const WeldedVertices& welded) {
  MemoryCharge charge(&MemoryOf(job));
  absl::Status full = charge.Grow(mesh.triangles.size(), sizeof(Corners), "looking for duplicate triangles");
  if (!full.ok()) return full;
  std::vector<Corners> sorted(mesh.triangles.size());
  for (size_t t = 0; t < sorted.size(); ++t) {
    for (size_t i = 0; i < 3; ++i) sorted[t][i] = welded.id[mesh.triangles[t][i]];
    std::sort(sorted[t].begin(), sorted[t].end());
  }
  tbb::parallel_sort(sorted.begin(), sorted.end());
  uint64_t duplicates = 0;
  for (size_t t = 1; t < sorted.size(); ++t) duplicates += sorted[t] == sorted[t - 1];
  return duplicates;
}

// Marks the triangles with a vertex that is not finite; empty if there is none. Counts those vertices.
std::vector<uint8_t> NotFinite(const TriangleMesh& mesh, uint64_t& count) {
  const auto finite = [](const Vec3d& p) { return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z); };
  for (const Vec3d& p : mesh.positions) count += !finite(p);
  std::vector<uint8_t> marks;
  if (count == 0) return marks;
  marks.resize(mesh.triangles.size());
  for (size_t t = 0; t < marks.size(); ++t) {
    for (const uint32_t v : mesh.triangles[t]) marks[t] |= uint8_t(!finite(mesh.positions[v]));
  }
  return marks;
}

}  // namespace

absl::StatusOr<MeshHealth> CheckHealth(const JobContext& job, const TriangleMesh& mesh) {
  const uint64_t vertices = mesh.positions.size(), triangles = mesh.triangles.size();
  MemoryCharge charge(&MemoryOf(job));
  if (absl::Status full = charge.Grow(vertices, kWeldBytes, "the health of the mesh"); !full.ok()) return full;
  if (absl::Status full = charge.Grow(triangles, 1, "the health of the mesh"); !full.ok()) return full;
  if (absl::Status over = job.Check(); !over.ok()) return over;

  MeshHealth health;
  const std::vector<uint8_t> left_out = NotFinite(mesh, health.not_finite_vertices);
  const WeldedVertices welded = Weld(mesh.positions);
  health.duplicate_vertices = vertices - welded.count;
  if (absl::Status over = job.Check(); !over.ok()) return over;
  health.degenerate_triangles = CountDegenerateTriangles(mesh);
  absl::StatusOr<uint64_t> duplicates = CountDuplicateTriangles(job, mesh, welded);
  if (!duplicates.ok()) return duplicates.status();
  health.duplicate_triangles = *duplicates;
  absl::StatusOr<ShellList> list = FindShells(job, mesh, welded, left_out);
  if (!list.ok()) return list.status();
  if (absl::Status over = MeasureShells(job, mesh, *list); !over.ok()) return over;
  health.edges = list->counts;
  health.shells = list->shells.size();
  for (const Shell& shell : list->shells) {
    health.closed_shells += shell.closed;
    health.flipped_shells += IsFlipped(shell);
    health.volume += shell.volume;
  }
  absl::StatusOr<OverlapCounts> overlaps = FindOverlaps(job, mesh, *list);
  if (!overlaps.ok()) return overlaps.status();
  health.overlaps = *overlaps;
  health.watertight = health.shells > 0 && health.edges.open == 0 && health.not_finite_vertices == 0;
  return health;
}

}  // namespace voxelpipe
