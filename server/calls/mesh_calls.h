// The calls for stored meshes.
#pragma once

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
#include "voxelpipe/v1/voxelization_service.grpc.pb.h"

namespace voxelpipe {

// The description of a stored mesh.
v1::StoredMesh ToMessage(KeptMesh& mesh);

// One UploadMesh call: receives the file; a loader hashes it, loads it unless an equal one exists or is being loaded,
// and stores it. If the client named the mesh and it is already stored, the call ends before the file has arrived: the
// client may then use the mesh, but has no claim on it. Lives until gRPC is done with the call and the loader with the
// file.
class UploadMeshCall final : public grpc::ServerReadReactor<grpc::ByteBuffer>,
                             public std::enable_shared_from_this<UploadMeshCall> {
 public:
  // `state` must outlive the reactor, `response` must live until the call ends.
  static UploadMeshCall* Create(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& response);

  void OnReadDone(bool ok) override;
  void OnCancel() override;
  void OnDone() override;

 private:
  using Loads = SingleFlight<KeptMesh>;

  UploadMeshCall(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& response);

  class FileTask;

  absl::Status TakeMessage(v1::UploadMeshRequest& message);
  absl::Status TakeUpload(const v1::MeshUpload& upload);
  absl::Status TakePiece(v1::UploadMeshRequest& message);
  void UploadEnded();
  // On the idle watch's thread.
  void GiveUp();

  // On a loader's thread.
  void Work();
  absl::StatusOr<std::shared_ptr<KeptMesh>> Load(std::vector<uint8_t> file, const std::string& id,
                                                 const JobContext& job);

  // Stores the loaded mesh, with a claim of this client, and ends the call.
  void Keep(const absl::StatusOr<std::shared_ptr<KeptMesh>>& mesh);

  // Ends the call; only the first one counts.
  void Answer(const absl::StatusOr<std::shared_ptr<KeptMesh>>& mesh, bool already_stored);
  void LeaveFlight();

  ServiceState& state_;
  const CallGate::Pass pass_;             // released when gRPC and the loader are both done
  grpc::CallbackServerContext& context_;  // used by gRPC's threads only
  grpc::ByteBuffer& response_;            // until the call is answered
  std::shared_ptr<UploadMeshCall> self_;  // until OnDone
  CallRecord record_;
  JobContext job_;

  // The upload: accessed by one read at a time, then by the loader.
  grpc::ByteBuffer read_;
  std::unique_ptr<IdleWatch::Wait> upload_wait_;
  uint64_t upload_bytes_seen_ = 0;
  bool begun_ = false;
  MeshFileType type_;
  std::string expected_id_;  // empty: not given
  std::deque<std::string> pieces_;
  BudgetShare uploads_;

  std::mutex mutex_;
  std::shared_ptr<FileTask> task_;
  std::optional<Loads::Seat> seat_;
  bool answered_ = false;
  absl::Status status_;
};

// In: the request of the call. Out: its response, or NOT_FOUND with ResourceInfo; INVALID_ARGUMENT for an id that is
// not valid.
absl::Status GetMesh(ServiceState& state, const v1::GetMeshRequest& request, v1::GetMeshResponse& response);
// A caller that is not an administrator releases its own claim; the mesh is deleted if no claim is left, otherwise
// kept_for_others is set. PERMISSION_DENIED if it has no claim. An administrator's call removes the mesh whatever
// claims it has.
absl::Status DeleteMesh(ServiceState& state, const CallRecord& caller, const v1::DeleteMeshRequest& request,
                        v1::DeleteMeshResponse& response);

}  // namespace voxelpipe
