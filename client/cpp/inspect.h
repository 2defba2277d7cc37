// A server's report on a mesh file. No gRPC and no protobuf in this header.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "client.h"
#include "mesh/contents.h"
#include "mesh/report.h"

namespace voxelpipe {

struct MeshInspection {
  MeshReport report;  // with degenerate triangles and open edges
  MeshContents contents;
  WarningList warnings;                                // including those of all its textures
  std::vector<std::pair<std::string, double>> stages;  // load and flatten, milliseconds on the server
};

// In: the bytes of a self-contained mesh file, below the server's max_message_bytes, because they are sent in one
// message. Connects for this call only. Errors: those of Client::Connect and Client::Estimate.
absl::StatusOr<MeshInspection> InspectMesh(const std::string& target, const ConnectOptions& options,
                                           std::span<const uint8_t> mesh_bytes, MeshFileType type,
                                           const JobContext& job);

}  // namespace voxelpipe
