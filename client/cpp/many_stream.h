// Many small jobs on one stream to a server: a frame loop, a batch. No gRPC and no protobuf in this header.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client.h"

namespace voxelpipe {

// The response to one job: as in Client::Voxelize, with the same errors.
struct ManyAnswer {
  uint64_t id = 0;
  absl::StatusOr<RemoteResult> result = absl::UnknownError("not answered");
};

// Made by Client::OpenMany, whose client and job must outlive it. Thread-safe: jobs may be sent by several threads
// while others receive.
class ManyStream {
 public:
  struct Impl;
  explicit ManyStream(std::unique_ptr<Impl> impl);
  // Cancels outstanding jobs.
  ~ManyStream();
  ManyStream(const ManyStream&) = delete;
  ManyStream& operator=(const ManyStream&) = delete;

  // Sends a job under an id chosen by the caller, not that of an outstanding job. Blocks while the window is full,
  // until another thread receives: a single thread must not exceed window() outstanding jobs. Errors: INVALID_ARGUMENT
  // for an id in use; UNAVAILABLE if the stream has ended, and Receive returns the reason.
  absl::Status Send(uint64_t id, std::span<const uint8_t> mesh_bytes, MeshFileType type,
                    const VoxelizeRequest& request);
  // The same with a stored mesh (Client::VoxelizeStored).
  absl::Status SendStored(uint64_t id, const std::string& mesh_name, const VoxelizeRequest& request,
                          std::span<const float> new_positions = {});
  // The same with several stored meshes on one grid (Client::VoxelizePlaced).
  absl::Status SendPlaced(uint64_t id, std::span<const PlacedStored> meshes, const VoxelizeRequest& request);
  // Ends sending. Call once.
  void FinishSending();

  // Waits for the next response, in order of completion. OUT_OF_RANGE after the last response once sending has ended;
  // another error if the stream failed, and with it all outstanding jobs.
  absl::StatusOr<ManyAnswer> Receive();

  size_t window() const;

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace voxelpipe
