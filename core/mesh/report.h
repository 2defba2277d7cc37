// Facts about a mesh for `voxelpipe info`, for the summary of a request, and for fill.
#pragma once

#include <cstdint>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "base/vec.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

struct MeshReport {
  uint64_t triangles = 0, vertices = 0;
  uint64_t degenerate_triangles = 0;  // zero area in world space (exactly collinear or with equal corners)
  uint64_t open_edges = 0;  // edges used by an odd number of triangles after welding equal positions (-0 = +0)
  Vec3d min{}, max{};       // box of the vertices that triangles use, world units; 0 if there are none
};

// Number of edges used by an odd number of triangles after welding equal positions (-0 = +0). 0 means closed.
// A degenerate edge (both ends equal after welding) is no edge. O(n log n) time; 8 bytes an edge and 8 a vertex are
// charged to MemoryOf(job). Errors: RESOURCE_EXHAUSTED; the job's. May throw bad_alloc.
absl::StatusOr<uint64_t> CountOpenEdges(const JobContext& job, const TriangleMesh& mesh);

// Number of triangles of zero area in world space (exactly collinear or with equal corners). O(triangles). Errors: the
// job's.
absl::StatusOr<uint64_t> CountDegenerateTriangles(const JobContext& job, const TriangleMesh& mesh);

// Errors and memory: those of CountOpenEdges.
absl::StatusOr<MeshReport> ReportMesh(const JobContext& job, const TriangleMesh& mesh);

// The cheap part of ReportMesh: no welding, no sort; degenerate triangles and open edges stay 0. O(triangles). Errors:
// the job's.
absl::StatusOr<MeshReport> BoxReport(const JobContext& job, const TriangleMesh& mesh);

}  // namespace voxelpipe
