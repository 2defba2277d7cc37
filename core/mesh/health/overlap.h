// Closed shells that lie inside others or intersect them.
#pragma once

#include <cstdint>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "mesh/health/edges.h"

namespace voxelpipe {

// Each closed shell is in at most one of the first four; those apart from all others are in none.
struct OverlapCounts {
  uint64_t nested = 0;       // every sample lies inside another closed shell
  uint64_t overlapping = 0;  // some samples do
  uint64_t boxes_only = 0;   // no sample does, but its box overlaps that of another closed shell
  uint64_t undecided = 0;    // not sampled, because the tests ran out
  // Of the nested ones: flipped, and inside shells that face outward, so that they take away from these.
  uint64_t cavities = 0;

  bool any() const { return nested + overlapping + boxes_only + undecided > cavities; }
};

// How it is decided: samples of a shell are its vertices (of at most 256 triangles, evenly spaced), moved by 1e-6 of
// its size towards the centre of its box, so that contact is no overlap. A sample lies inside another closed shell if
// the winding number there is not 0, or, of a shell without orientation, if the number of crossings is odd, along the
// line in x (raster/crossing.h). Two shells of which only edges pierce the other's triangles, such as two crossed bars,
// are therefore in `boxes_only`. Boxes overlap if they share an interior.
//
// Time: O(n log n), bounded: at most 256 line tests a triangle and 2^24 more, and as many comparisons of boxes a shell;
// what is left then is undecided. Memory: 48 bytes a triangle, 40 a shell and one a vertex, charged to MemoryOf(job).
// Deterministic, on one thread. Errors: RESOURCE_EXHAUSTED; the job's. May throw bad_alloc.
absl::StatusOr<OverlapCounts> FindOverlaps(const JobContext& job, const TriangleMesh& mesh, const ShellList& list);

}  // namespace voxelpipe
