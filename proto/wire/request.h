// Requests: core types <-> messages. Used by the server and by the client.
#pragma once

#include <string>

#include "absl/status/statusor.h"
#include "job/request.h"
#include "load/loader.h"
#include "voxelpipe/v1/voxelization_service.pb.h"
#include "wire/call_settings.h"

namespace voxelpipe {

// A config in the types of the core.
struct ParsedConfig {
  MeshFormat mesh_format = MeshFormat::kAuto;
  VoxelizeRequest request;  // threads stays 0: clients do not choose it
  CallSettings settings;
  std::string mesh_id;         // of a stored mesh; empty: the mesh comes with the request
  bool new_positions = false;  // the mesh bytes are positions for mesh_id
};

v1::MeshFormat ToMessage(MeshFormat format);
// INVALID_ARGUMENT naming `field` for a value that this server does not know.
absl::StatusOr<MeshFormat> ParseMeshFormat(v1::MeshFormat format, const std::string& field);

// In: a message from a client. Out: the request with every default filled in. ValidateRequest checks shaders and
// blends. Errors: INVALID_ARGUMENT "field: why" for enum values that this server does not know, a shader parameter
// given twice, a grid given in two forms, more than kMaxTargets targets, a negative queue time-out, or new positions
// without a mesh id.
absl::StatusOr<ParsedConfig> ParseConfig(const v1::VoxelizeConfig& config);

// The inverse of ParseConfig, without `threads`.
v1::VoxelizeConfig MakeConfig(const VoxelizeRequest& request, MeshFormat mesh_format = MeshFormat::kAuto,
                              const CallSettings& settings = {});

}  // namespace voxelpipe
