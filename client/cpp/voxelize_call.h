// One Voxelize or VoxelizeUpload call: uploads and downloads at the same time.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "absl/status/statusor.h"
#include "client.h"
#include "raw_calls.h"
#include "voxelpipe/v1/request.pb.h"

namespace voxelpipe {

// The mesh of a call: a file; a stored mesh, with its own or new positions; or several stored ones, placed.
struct MeshSource {
  std::span<const uint8_t> bytes;  // the file, or the new positions
  MeshFileType type;
  std::optional<std::string> stored;                    // the name
  std::optional<std::span<const PlacedStored>> placed;  // neither: a file

  static MeshSource File(std::span<const uint8_t> bytes, MeshFileType type) { return {bytes, type, {}, {}}; }
  static MeshSource Stored(std::string name, std::span<const float> new_positions) {
    return {
        {reinterpret_cast<const uint8_t*>(new_positions.data()), new_positions.size_bytes()}, {}, std::move(name), {}};
  }
  static MeshSource Placed(std::span<const PlacedStored> meshes) { return {{}, {}, {}, meshes}; }
};

// INVALID_ARGUMENT, as in-process, for a request that messages cannot express: without targets, which in messages means
// one bit target, or with a grid in none of its four forms (the errors of CheckGridRequest).
absl::Status CheckSendable(const VoxelizeRequest& request);

// In: an empty message. Out: the mesh with all of its bytes and their CRC-32C, or without them.
void WriteWithBytes(const MeshSource& mesh, v1::MeshSource& message);
void WriteWithoutBytes(const MeshSource& mesh, v1::MeshSource& message);

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
