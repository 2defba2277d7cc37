// Prepares a stored mesh for one job.
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

// In: a mesh from `store`, a config, and the bytes of new positions (config.new_positions), if any. Out: the mesh with
// the textures that the request reads, shared with all other jobs; or, with new positions, a copy with only these
// replaced (MovedMeshes): it has no skeleton and no morph targets, and a device that has the mesh receives only the
// positions. Errors: INVALID_ARGUMENT with the expected and the received number of bytes, or naming the first vertex
// that is not finite; those of PrepareTextures; the job's; RESOURCE_EXHAUSTED out of memory. Never throws.
absl::StatusOr<std::shared_ptr<const PreparedMesh>> PrepareKept(MeshStore& store, KeptMesh& kept,
                                                                std::span<const uint8_t> positions,
                                                                const ParsedConfig& config, const JobLimits& limits,
                                                                const JobContext& job);

// Checks the number of bytes after a config with this mesh: none, or its new positions. `all`: true if no more will
// follow. Otherwise INVALID_ARGUMENT with the expected and the received size.
absl::Status CheckMeshBytes(const KeptMesh& kept, const ParsedConfig& config, uint64_t bytes, bool all);

}  // namespace voxelpipe
