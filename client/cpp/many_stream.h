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

// The answer to one job: as of Client::Voxelize, with the same errors.
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
  // Cancels what is not answered.
  ~ManyStream();
  ManyStream(const ManyStream&) = delete;
  ManyStream& operator=(const ManyStream&) = delete;

  // Sends a job under an id of the caller's, which no unanswered job has. Waits while the window is full, until
  // somebody receives: who sends and receives on one thread keeps at most window() jobs unanswered.
  // Errors: INVALID_ARGUMENT for an id in use; UNAVAILABLE where the stream has ended, and Receive says why.
  absl::Status Send(uint64_t id, std::span<const uint8_t> mesh_bytes, MeshFormat format,
                    const VoxelizeRequest& request);
  // The same with a mesh that the server keeps (Client::VoxelizeStored).
  absl::Status SendStored(uint64_t id, const std::string& mesh_id, const VoxelizeRequest& request,
                          std::span<const float> new_positions = {});
  // No more jobs come. Call once.
  void FinishSending();

  // Waits for the next answer, in the order in which jobs are done. OUT_OF_RANGE when all jobs are answered and no more
  // come; another error where the stream ended, and with it all unanswered jobs.
  absl::StatusOr<ManyAnswer> Receive();

  size_t window() const;

 private:
  std::unique_ptr<Impl> impl_;
};

}  // namespace voxelpipe
