// The health of a mesh: what in it keeps a fill from being exact.
#pragma once

#include <cstdint>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/health/edges.h"
#include "mesh/health/overlap.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

struct MeshHealth {
  EdgeCounts edges;                   // after welding equal positions (-0 = +0)
  uint64_t degenerate_triangles = 0;  // as MeshReport::degenerate_triangles
  uint64_t duplicate_triangles = 0;   // with the same three corners as a triangle before them, in any order
  uint64_t duplicate_vertices = 0;    // at the position of another; usual where attributes differ along seams
  uint64_t not_finite_vertices = 0;   // with a NaN or an infinity; the loader refuses them
  uint64_t shells = 0;                // connected through shared edges
  uint64_t closed_shells = 0;         // those without open edges
  uint64_t flipped_shells = 0;        // closed and oriented, with a negative signed volume: they face inward
  double volume = 0;                  // of the closed, oriented shells, signed, world units cubed
  OverlapCounts overlaps;             // of the closed shells
  bool watertight = false;            // there are triangles, and no open edges
};

// In: a mesh of fewer than 2^32 triangles and vertices. Out: its health. Triangles with a vertex that is not finite
// count among duplicate and degenerate ones only. O(n log n) time; its scratch memory, at most 9 bytes a vertex, 53 a
// triangle and 120 a shell, is charged to MemoryOf(job). Deterministic. Errors: RESOURCE_EXHAUSTED; the job's. May
// throw bad_alloc.
absl::StatusOr<MeshHealth> CheckHealth(const JobContext& job, const TriangleMesh& mesh);

}  // namespace voxelpipe
