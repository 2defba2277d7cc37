// How triangles share edges, and the shells that they form.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "base/memory_budget.h"
#include "mesh/triangle_mesh.h"
#include "mesh/weld.h"

namespace voxelpipe {

// Counts of undirected edges after welding. An edge whose ends are equal is none, and a triangle with two equal corners
// has none: it would use its long edge twice.
struct EdgeCounts {
  uint64_t edges = 0;
  uint64_t open = 0;          // used by an odd number of triangles, as MeshReport::open_edges
  uint64_t non_manifold = 0;  // used by more than two triangles
  uint64_t inconsistent = 0;  // used by an even number of triangles, not half of them in each direction
};

// Triangles that are connected through shared edges.
struct Shell {
  uint32_t first_triangle = 0;  // the smallest id among them
  uint64_t triangles = 0;
  bool closed = true;    // no open edge
  bool oriented = true;  // no open and no inconsistent edge
  // Filled in by MeasureShells.
  Vec3d min{}, max{};  // world units
  double volume = 0;   // signed, in world units cubed; positive if the triangles face outward
};

inline constexpr uint32_t kNoShell = UINT32_MAX;

struct ShellList {
  EdgeCounts counts;
  std::vector<Shell> shells;       // by ascending first_triangle
  std::vector<uint32_t> shell_of;  // of each triangle; kNoShell without edges
  MemoryCharge memory{};           // of the two lists
};

// In: a mesh of fewer than 2^32 triangles, its welded vertices, and for each triangle whether it is left out (empty:
// none). O(n log n) time; 52 bytes a triangle and 80 a shell are charged to MemoryOf(job). Errors: RESOURCE_EXHAUSTED;
// the job's. May throw bad_alloc.
absl::StatusOr<ShellList> FindShells(const JobContext& job, const TriangleMesh& mesh, const WeldedVertices& welded,
                                     const std::vector<uint8_t>& left_out);

}  // namespace voxelpipe
