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

// LoadMeshFor (load/load_mesh.h), by `workers` where the file may need a decoder that others wrote
// (load/decode/foreign_decoders.h). Without `workers` (null) always in this process. The file is freed as soon as it is
// loaded.
// Errors: those of LoadMeshFor and of LoadWorkers::Load; what is wrong with the file as a whole is about the field
// "mesh" (WithField). May throw bad_alloc.
absl::StatusOr<LoadedMesh> LoadMesh(std::vector<uint8_t> file, const LoadRequest& request, LoadWorkers* workers,
                                    const JobContext& job);

// PrepareTexturesFor (load/decode/image.h) of a mesh whose images may be encoded, likewise.
absl::Status DecodeTextures(TriangleMesh& mesh, const LoadLimits& limits, const TextureUse& use, LoadWorkers* workers,
                            const JobContext& job);

}  // namespace voxelpipe
