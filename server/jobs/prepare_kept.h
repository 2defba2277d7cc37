// Prepares a stored mesh, or several that are placed on one grid, for one job.
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

// Meshes of a store that a job uses: one, or those of config.placed in their order.
using KeptMeshes = std::span<const std::shared_ptr<KeptMesh>>;

// In: meshes from `store`, a config, and the bytes of new positions (config.new_positions), if any. Out: the mesh with
// the textures that the request reads, shared with all other jobs; or, with new positions, a copy with only these
// replaced (MovedMeshes): it has no skeleton and no morph targets, and a device that has the mesh receives only the
// positions; or the mesh that PlaceMeshes makes of config.placed, charged to the job. Of each of these a copy without
// the parts that the request excludes (LeaveOutParts). Errors: INVALID_ARGUMENT with the expected and the received
// number of bytes, or naming the first vertex that is not finite; those of PrepareTextures, naming which of the placed
// meshes it is, and of PlaceMeshes; the job's; RESOURCE_EXHAUSTED out of memory. Never throws.
absl::StatusOr<std::shared_ptr<const PreparedMesh>> PrepareKept(MeshStore& store, KeptMeshes kept,
                                                                std::span<const uint8_t> positions,
                                                                const ParsedConfig& config, const JobLimits& limits,
                                                                const JobContext& job);

// Of all together, each as often as it is placed.
uint64_t TrianglesOf(KeptMeshes kept);

// Checks the number of bytes after a config with these meshes: none, or new positions. `all`: true if no more will
// follow. Otherwise INVALID_ARGUMENT with the expected and the received size.
absl::Status CheckMeshBytes(KeptMeshes kept, const ParsedConfig& config, uint64_t bytes, bool all);

}  // namespace voxelpipe
