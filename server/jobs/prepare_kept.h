// A mesh that the server keeps -> what a worker needs for one job.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "jobs/job.h"
#include "meshes/mesh_store.h"
#include "wire/request.h"

namespace voxelpipe {

// In: a mesh that came from `store`, a config, and the bytes of its new positions (config.new_positions; see
// types.proto), else none.
// Out: the mesh with the textures that the request reads, shared with all other jobs; or, with new positions, a copy in
// which only they are exchanged (MovedMeshes): it follows no skeleton and no morph target any more, and a device that
// has the mesh gets the positions alone.
// Errors: INVALID_ARGUMENT saying how many bytes are wanted and came, or naming the first vertex that is not finite;
// those of PrepareTextures; the job's; RESOURCE_EXHAUSTED out of memory. Never throws.
absl::StatusOr<std::shared_ptr<const PreparedMesh>> PrepareKept(MeshStore& store, KeptMesh& kept,
                                                                std::span<const uint8_t> positions,
                                                                const ParsedConfig& config, const JobLimits& limits,
                                                                const JobContext& job);

// Checks that `bytes` is what must follow a config with this mesh: nothing, or its new positions. `all`: no more will
// follow. INVALID_ARGUMENT naming size wanted and got otherwise.
absl::Status CheckMeshBytes(const KeptMesh& kept, const ParsedConfig& config, uint64_t bytes, bool all);

}  // namespace voxelpipe
