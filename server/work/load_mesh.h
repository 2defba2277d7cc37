// Mesh file -> flattened mesh, with what a request's summary says of it.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "load/limits.h"
#include "load/loader.h"
#include "mesh/contents.h"
#include "mesh/report.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

struct LoadedMesh {
  TriangleMesh mesh;
  MeshContents contents;
  double load_ms = 0, flatten_ms = 0;
  uint64_t peak_bytes = 0;  // the largest of file and scene, scene and flattened mesh, computed from sizes
};

// In: the whole file. It is freed as soon as it is loaded, the scene as soon as it is flat. `job` is looked at within the steps, and
// told of "load" and "flatten".
// Errors: those of LoadScene and Flatten; the job's. May throw bad_alloc.
absl::StatusOr<LoadedMesh> LoadMesh(std::vector<uint8_t> file, MeshFormat format, const LoadLimits& limits,
                                    const JobContext& job);

// The cheap part of ReportMesh: no welding, no sort; degenerate triangles and open edges stay 0. O(triangles).
MeshReport BoxReport(const TriangleMesh& mesh);

}  // namespace voxelpipe
