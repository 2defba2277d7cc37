// From a request message to a job that can be submitted: the same for single calls and for many on one stream.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "jobs/voxelize_job.h"
#include "observe/log.h"
#include "reply/result_pieces.h"
#include "state/service_state.h"

namespace voxelpipe {

// Fills the job's config, limits and traits from the message; `client` is the client for the queue. The job's deadline,
// if any, must be set before. If it names stored meshes, the job gets them, and their use is counted.
// Errors: those of ParseRequest, PrepareRequest and WorkerPool::CheckServed; NOT_FOUND (MissingMeshesError).
absl::Status ConfigureJob(ServiceState& state, const v1::VoxelizeRequest& message, const std::string& client,
                          VoxelizeJob& job);

// The bytes that come in the request itself: of its mesh, or of the new positions of its stored mesh.
struct MeshData {
  std::string* bytes = nullptr;  // null: none
  std::optional<uint32_t> crc32c;
};
MeshData MeshDataOf(v1::VoxelizeRequest& request);

// DATA_LOSS naming the offset in the mesh if `bytes` do not have this CRC-32C.
absl::Status CheckMeshCrc(std::string_view bytes, std::optional<uint32_t> crc32c, uint64_t offset);

// The piece sizes of results, from the options.
PieceOptions PiecesOf(const ServerOptions& options);

}  // namespace voxelpipe
