// Opens VoxelizeBatch streams.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "client.h"
#include "many_stream.h"
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe {

// See Client::OpenMany. All arguments passed by reference must outlive the stream. `target` names the server in errors.
std::unique_ptr<ManyStream> OpenManyStream(v1::VoxelizationService::Stub& stub, const std::string& target,
                                           const ConnectOptions& options, const JobContext& job, size_t window);

}  // namespace voxelpipe
