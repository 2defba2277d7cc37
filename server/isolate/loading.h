// The server's one entry for untrusted mesh files: decides where a mesh is loaded.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "load/load_mesh.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

class LoadWorkers;

// LoadMeshFor (load/load_mesh.h), in `workers` if the file may need a third-party decoder
// (load/decode/foreign_decoders.h). Always in this process if `workers` is null. The file is freed as soon as it is
// loaded. Errors: those of LoadMeshFor and of LoadWorkers::Load. May throw bad_alloc.
absl::StatusOr<LoadedMesh> LoadMesh(std::vector<uint8_t> file, const LoadRequest& request, LoadWorkers* workers,
                                    const JobContext& job);

// PrepareTexturesFor (load/decode/image.h) for a mesh whose images may be encoded, in the same way.
absl::Status DecodeTextures(TriangleMesh& mesh, const LoadLimits& limits, const TextureUse& use, LoadWorkers* workers,
                            const JobContext& job);

}  // namespace voxelpipe
