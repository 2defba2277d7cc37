// Requests: core types <-> messages. Used by the server and by the client.
#pragma once

#include "absl/status/statusor.h"
#include "load/loader.h"
#include "pipeline/request.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// A config as the core understands it.
struct ParsedConfig {
  MeshFormat mesh_format = MeshFormat::kAuto;
  VoxelizeRequest request;  // threads stays 0: clients do not choose it
};

// In: what a client sent. Out: the request with every default filled in; shaders and blends are not checked yet
// (ValidateRequest does).
// Errors: INVALID_ARGUMENT "field: why" for enum values that this server does not know, a shader parameter given twice, a
// grid asked for in two ways, or more than kMaxTargets targets.
absl::StatusOr<ParsedConfig> ParseConfig(const v1::VoxelizeConfig& config);

// The message that ParseConfig turns back into `request`, except for its threads.
v1::VoxelizeConfig MakeConfig(const VoxelizeRequest& request, MeshFormat mesh_format = MeshFormat::kAuto);

}  // namespace voxelpipe
