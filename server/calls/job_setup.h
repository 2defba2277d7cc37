// From a config message to a job that can be submitted: the same for single calls and for many on one stream.
#pragma once

#include <string>

#include "absl/status/status.h"
#include "jobs/voxelize_job.h"
#include "observe/log.h"
#include "reply/result_pieces.h"
#include "state/service_state.h"

namespace voxelpipe {

// Fills the job's config, limits and traits from the message; `client` is the client for the queue. The job's deadline,
// if any, must be set before. If the config names a stored mesh, the job gets that mesh, and its use is counted.
// Errors: those of ParseConfig, PrepareRequest and WorkerPool::CheckServed; NOT_FOUND (MissingMeshError).
absl::Status ConfigureJob(ServiceState& state, const v1::VoxelizeConfig& message, const std::string& client,
                          VoxelizeJob& job);

// The piece sizes of results, from the options.
PieceOptions PiecesOf(const ServerOptions& options);

}  // namespace voxelpipe
