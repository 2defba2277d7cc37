// One Voxelize call: uploads and downloads at the same time.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "client.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe {

// See Client::VoxelizeTo. `target` names the server in errors.
absl::StatusOr<RemoteRun> CallVoxelizeTo(v1::VoxelizationService::Stub& stub, const std::string& target,
                                         uint64_t max_result_bytes, std::span<const uint8_t> mesh_bytes,
                                         MeshFormat format, const VoxelizeRequest& request, const JobContext& job,
                                         ResultSink& sink, const std::function<void(const Plan&)>& on_plan);

// See Client::Voxelize. `target` names the server in errors.
absl::StatusOr<RemoteResult> CallVoxelize(v1::VoxelizationService::Stub& stub, const std::string& target,
                                          uint64_t max_result_bytes, std::span<const uint8_t> mesh_bytes,
                                          MeshFormat format, const VoxelizeRequest& request, const JobContext& job,
                                          const std::function<void(const Plan&)>& on_plan);

}  // namespace voxelpipe
