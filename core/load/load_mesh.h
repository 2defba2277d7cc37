// Mesh file -> flattened mesh: the steps of a server's job and of the command line.
#pragma once

#include <cstdint>
#include <functional>
#include <span>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "load/decode/mesh_format.h"
#include "mesh/contents.h"
#include "mesh/scene/load_limits.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// How a mesh file is to be read.
struct LoadRequest {
  MeshFileType type = {};
  TextureUse textures = {};  // those that are decoded at once
  LoadLimits limits = {};
};

struct LoadedMesh {
  TriangleMesh mesh;
  MeshContents contents;
  double load_ms = 0, flatten_ms = 0;  // decoding the textures is part of loading
  uint64_t peak_bytes = 0;             // the largest of file and scene, scene and flattened mesh, computed from sizes
};

// In: the whole file; `file_used` is called as soon as its bytes are not needed any more. Out: its mesh, with the
// textures decoded that the request names. The scene is freed as soon as it is flat. `job` is polled within the steps,
// and receives the stages "load" and "flatten".
// Errors: those of LoadSceneFor, FlattenFor and PrepareTexturesFor; the job's. May throw bad_alloc.
absl::StatusOr<LoadedMesh> LoadMeshFor(const JobContext& job, std::span<const uint8_t> file, const LoadRequest& request,
                                       const std::function<void()>& file_used = {});

}  // namespace voxelpipe
