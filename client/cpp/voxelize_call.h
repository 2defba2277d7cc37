// One Voxelize call: uploads and downloads at the same time.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "client.h"
#include "raw_calls.h"

namespace voxelpipe {

// The mesh of a call: a file, or a stored mesh, with its own or new positions.
struct MeshSource {
  std::span<const uint8_t> bytes;  // the file, or the new positions
  MeshFileType type;
  std::string mesh_id;  // empty: a file

  static MeshSource File(std::span<const uint8_t> bytes, MeshFileType type) { return {bytes, type, {}}; }
  static MeshSource Stored(std::string mesh_id, std::span<const float> new_positions) {
    return {
        {reinterpret_cast<const uint8_t*>(new_positions.data()), new_positions.size_bytes()}, {}, std::move(mesh_id)};
  }
};

// See Client::VoxelizeTo. `target` names the server in errors.
absl::StatusOr<RemoteRun> CallVoxelizeTo(const RawCalls& calls, const std::string& target, uint64_t max_result_bytes,
                                         const CallSettings& settings, const MeshSource& mesh,
                                         const VoxelizeRequest& request, const JobContext& job, ResultSink& sink,
                                         const std::function<void(const Plan&)>& on_plan);

// See Client::Voxelize. `target` names the server in errors.
absl::StatusOr<RemoteResult> CallVoxelize(const RawCalls& calls, const std::string& target, uint64_t max_result_bytes,
                                          const CallSettings& settings, const MeshSource& mesh,
                                          const VoxelizeRequest& request, const JobContext& job,
                                          const std::function<void(const Plan&)>& on_plan);

}  // namespace voxelpipe
