// A local mesh file, loaded in this process.
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "engine/engine.h"
#include "mesh/scene/scene.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe::cli {

struct LoadedMesh {
  Scene scene;
  TriangleMesh mesh;
  uint64_t packed_bytes = 0;  // of the self-contained file, including siblings
  double load_ms = 0, flatten_ms = 0;
};

// Loads and flattens. Errors: those of LoadScene and Flatten; CANCELLED between the steps.
absl::StatusOr<LoadedMesh> LoadMesh(MeshInput mesh, const JobContext& job);

}  // namespace voxelpipe::cli
