// Mesh file -> flattened mesh, with the facts for the summary of a request.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "load/loader.h"
#include "mesh/contents.h"
#include "mesh/report.h"
#include "mesh/scene/load_limits.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// How to read a mesh file.
struct LoadRequest {
  MeshFormat format = MeshFormat::kAuto;
  TextureUse textures;  // those to decode immediately
  LoadLimits limits;
};

struct LoadedMesh {
  TriangleMesh mesh;
  MeshContents contents;
  double load_ms = 0, flatten_ms = 0;
  uint64_t peak_bytes = 0;  // the largest of file and scene, scene and flattened mesh, computed from sizes
};

// In: the whole file; `file_used` is called as soon as its bytes are no longer needed. Out: its mesh, with the textures
// decoded that the request names, made in this process. The scene is freed after flattening. `job` is polled within the
// steps, and receives the stages "load" and "flatten". Errors: those of LoadSceneFor, FlattenFor and
// PrepareTexturesFor; the job's. May throw bad_alloc.
absl::StatusOr<LoadedMesh> LoadMeshFor(std::span<const uint8_t> file, const LoadRequest& request,
                                        const JobContext& job, const std::function<void()>& file_used = {});

// The cheap part of ReportMesh: no welding, no sort; degenerate triangles and open edges stay 0. O(triangles).
MeshReport BoxReport(const TriangleMesh& mesh);

}  // namespace voxelpipe
