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
  MeshFileType mesh_type;   // of the mesh that comes with the request
  VoxelizeRequest request;  // threads stays 0: clients do not choose it
  CallSettings settings;
  bool default_targets = false, default_result = false;  // the message leaves them open
  std::string mesh_id;                                   // of a stored mesh; empty: the mesh comes with the request
  bool new_positions = false;                            // the mesh bytes are positions for mesh_id
};

v1::MeshFormat ToMessage(MeshFormat format);
v1::LengthUnit ToMessage(LengthUnit unit);
// INVALID_ARGUMENT naming the field, mesh_format or mesh_unit behind `prefix`, for a value that this server does not
// know.
absl::StatusOr<MeshFileType> ParseMeshType(v1::MeshFormat format, v1::LengthUnit unit, const std::string& prefix = "");

// In: a message from a client. Out: the request with every default filled in. ValidateRequest checks shaders and
// blends. Errors: INVALID_ARGUMENT "field: why" for enum values that this server does not know, a shader parameter
// given twice, a grid given in two forms, more than kMaxTargets targets, a negative queue time-out, new positions
// without a mesh id, or a unit of a stored mesh.
absl::StatusOr<ParsedConfig> ParseConfig(const v1::VoxelizeConfig& config);

// The inverse of ParseConfig, without `threads`.
v1::VoxelizeConfig MakeConfig(const VoxelizeRequest& request, MeshFileType mesh_type = {},
                              const CallSettings& settings = {});

}  // namespace voxelpipe
