// From the bytes of a mesh file to a stored mesh: what CreateMesh and UploadMesh have in common.
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "calls/call_record.h"
#include "load/loader.h"
#include "meshes/mesh_store.h"
#include "results/single_flight.h"
#include "schedule/byte_budget.h"
#include "state/service_state.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// The description of a stored mesh.
v1::Mesh ToMessage(KeptMesh& mesh);

// A derived class is the reactor of the call: it takes the pieces, and forwards gRPC's events to Cancelled and Ended. A
// loader hashes the file, loads it unless an equal one is stored or is being loaded, and stores it. Lives until gRPC is
// done with the call and the loader with the file.
class MeshUpload : public std::enable_shared_from_this<MeshUpload> {
 protected:
  // `response` must live until the call ends.
  MeshUpload(ServiceState& state, grpc::CallbackServerContext& context, Rpc rpc, grpc::ByteBuffer& response);
  ~MeshUpload() = default;

  // With mutex_ held.
  absl::Status TakePiece(std::string piece, std::optional<uint32_t> crc32c);
  // After the last piece.
  void SubmitFile();
  // Ends the call; only the first one counts.
  void Answer(const absl::StatusOr<std::shared_ptr<KeptMesh>>& mesh, bool already_stored);

  // gRPC's events.
  void Cancelled();
  void Ended();

  // The reactor's Finish.
  virtual void FinishCall(const grpc::Status& status) = 0;

  ServiceState& state_;
  const CallGate::Pass pass_;             // released when gRPC and the loader are both done
  grpc::CallbackServerContext& context_;  // used by gRPC's threads only
  std::shared_ptr<MeshUpload> self_;      // until Ended
  CallRecord record_;
  JobContext job_;
  MeshFileType type_;
  std::string expected_name_;  // empty: not given

  std::mutex mutex_;
  bool answered_ = false;

 private:
  using Loads = SingleFlight<KeptMesh>;
  class FileTask;

  // On a loader's thread.
  void Work();
  absl::StatusOr<std::shared_ptr<KeptMesh>> Load(std::vector<uint8_t> file, const std::string& name,
                                                 const JobContext& job);
  // Stores the loaded mesh, with a claim of this client, and ends the call.
  void Keep(const absl::StatusOr<std::shared_ptr<KeptMesh>>& mesh);
  void LeaveFlight();

  grpc::ByteBuffer& response_;  // until the call is answered
  // Accessed by one read at a time, then by the loader.
  std::deque<std::string> pieces_;
  BudgetShare uploads_;

  std::shared_ptr<FileTask> task_;
  std::optional<Loads::Seat> seat_;
  absl::Status status_;
};

}  // namespace voxelpipe
