// The calls for stored meshes.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "absl/status/statusor.h"
#include "client.h"
#include "raw_calls.h"

namespace voxelpipe {

// See Client::UploadMesh. `target` names the server in errors.
absl::StatusOr<StoredMesh> CallUploadMesh(const RawCalls& calls, const std::string& target,
                                          std::span<const uint8_t> mesh_bytes, MeshFileType type,
                                          const JobContext& job);

// DATA_LOSS if the message does not name a mesh.
absl::StatusOr<StoredMesh> FromMessage(const v1::Mesh& message);

}  // namespace voxelpipe
