#include "mesh/health/health.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/long_loops.h"
#include "base/memory_budget.h"
#include "base/parallel.h"
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
  std::vector<Corners> sorted;
  if (absl::Status over = Resize(job, sorted, mesh.triangles.size()); !over.ok()) return over;
  absl::Status over =
      ParallelChunks(int64_t(sorted.size()), int64_t(kElementsAStep), job, [&](int64_t begin, int64_t end) {
        for (size_t t = size_t(begin); t < size_t(end); ++t) {
          for (size_t i = 0; i < 3; ++i) sorted[t][i] = welded.id[mesh.triangles[t][i]];
          std::sort(sorted[t].begin(), sorted[t].end());
        }
      });
  if (!over.ok()) return over;
  if (over = ParallelSort(job, sorted); !over.ok()) return over;
  uint64_t duplicates = 0;
  over = InSteps(job, sorted.size(), [&](uint64_t begin, uint64_t end) {
    for (uint64_t t = std::max<uint64_t>(begin, 1); t < end; ++t) duplicates += sorted[t] == sorted[t - 1];
  });
  if (!over.ok()) return over;
  return duplicates;
}

// Marks the triangles with a vertex that is not finite; empty if there is none. Counts those vertices.
absl::StatusOr<std::vector<uint8_t>> NotFinite(const JobContext& job, const TriangleMesh& mesh, uint64_t& count) {
  const auto finite = [](const Vec3d& p) { return std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z); };
  absl::Status over = InSteps(job, mesh.positions.size(), [&](uint64_t begin, uint64_t end) {
    for (uint64_t v = begin; v < end; ++v) count += !finite(mesh.positions[v]);
  });
  if (!over.ok()) return over;
  std::vector<uint8_t> marks;
  if (count == 0) return marks;
  marks.reserve(mesh.triangles.size());
  over = InSteps(job, mesh.triangles.size(), [&](uint64_t begin, uint64_t end) {
    for (uint64_t t = begin; t < end; ++t) {
      uint8_t mark = 0;
      for (const uint32_t v : mesh.triangles[t]) mark |= uint8_t(!finite(mesh.positions[v]));
      marks.push_back(mark);
    }
  });
  if (!over.ok()) return over;
  return marks;
}

}  // namespace

absl::StatusOr<MeshHealth> CheckHealth(const JobContext& job, const TriangleMesh& mesh) {
  const uint64_t vertices = mesh.positions.size(), triangles = mesh.triangles.size();
  MemoryCharge charge(&MemoryOf(job));
  if (absl::Status full = charge.Grow(vertices, kWeldBytes, "the health of the mesh"); !full.ok()) return full;
  if (absl::Status full = charge.Grow(triangles, 1, "the health of the mesh"); !full.ok()) return full;

  MeshHealth health;
  const absl::StatusOr<std::vector<uint8_t>> left_out = NotFinite(job, mesh, health.not_finite_vertices);
  if (!left_out.ok()) return left_out.status();
  const absl::StatusOr<WeldedVertices> welded = Weld(job, mesh.positions);
  if (!welded.ok()) return welded.status();
  health.duplicate_vertices = vertices - welded->count;
  const absl::StatusOr<uint64_t> degenerate = CountDegenerateTriangles(job, mesh);
  if (!degenerate.ok()) return degenerate.status();
  health.degenerate_triangles = *degenerate;
  const absl::StatusOr<uint64_t> duplicates = CountDuplicateTriangles(job, mesh, *welded);
  if (!duplicates.ok()) return duplicates.status();
  health.duplicate_triangles = *duplicates;
  absl::StatusOr<ShellList> list = FindShells(job, mesh, *welded, *left_out);
  if (!list.ok()) return list.status();
  if (absl::Status over = MeasureShells(job, mesh, *list); !over.ok()) return over;
  health.edges = list->counts;
  health.shells = list->shells.size();
  absl::Status over = InSteps(job, list->shells.size(), [&](uint64_t begin, uint64_t end) {
    for (uint64_t s = begin; s < end; ++s) {
      const Shell& shell = list->shells[s];
      health.closed_shells += shell.closed;
      health.flipped_shells += IsFlipped(shell);
      health.volume += shell.volume;
    }
  });
  if (!over.ok()) return over;
  absl::StatusOr<OverlapCounts> overlaps = FindOverlaps(job, mesh, *list);
  if (!overlaps.ok()) return overlaps.status();
  health.overlaps = *overlaps;
  health.watertight = health.shells > 0 && health.edges.open == 0 && health.not_finite_vertices == 0;
  return health;
}

}  // namespace voxelpipe
