// The calls for stored meshes.
#pragma once

#include <cstdint>
#include <memory>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "calls/call_record.h"
#include "calls/mesh_upload.h"
#include "state/idle_watch.h"
#include "state/service_state.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

// One CreateMesh call: the file is in its message.
class CreateMeshCall final : public grpc::ServerUnaryReactor, public MeshUpload {
 public:
  // Reads `request`. `state` must outlive the reactor, `response` must live until the call ends.
  static CreateMeshCall* Create(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& request,
                                grpc::ByteBuffer& response);

  void OnCancel() override { Cancelled(); }
  void OnDone() override { Ended(); }
  bool InternalInlineable() override { return kReactAtOnce; }

 private:
  CreateMeshCall(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& response);

  absl::Status TakeMessage(grpc::ByteBuffer& bytes);
  void FinishCall(const grpc::Status& status) override { Finish(status); }
};

// One UploadMesh call: receives the file in pieces. If the client named the mesh and it is already stored, the call
// ends before the file has arrived: the client may then use the mesh, but has no claim on it.
class UploadMeshCall final : public grpc::ServerReadReactor<grpc::ByteBuffer>, public MeshUpload {
 public:
  // `state` must outlive the reactor, `response` must live until the call ends.
  static UploadMeshCall* Create(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& response);

  void OnReadDone(bool ok) override;
  void OnCancel() override { Cancelled(); }
  void OnDone() override { Ended(); }

 private:
  UploadMeshCall(ServiceState& state, grpc::CallbackServerContext& context, grpc::ByteBuffer& response);

  // With mutex_ held.
  absl::Status TakeMessage(v1::UploadMeshRequest& message);
  absl::Status TakeUpload(const v1::MeshUpload& upload);
  void UploadEnded();
  // On the idle watch's thread.
  void GiveUp();
  void FinishCall(const grpc::Status& status) override { Finish(status); }

  // Accessed by one read at a time.
  grpc::ByteBuffer read_;
  std::unique_ptr<IdleWatch::Wait> upload_wait_;
  uint64_t upload_bytes_seen_ = 0;
  bool begun_ = false;
};

// Errors of all: INVALID_ARGUMENT for a name that no mesh can have; NOT_FOUND with ResourceInfo.
absl::Status GetMesh(ServiceState& state, const v1::GetMeshRequest& request, v1::Mesh& response);
// The meshes on which the caller has a claim, of an administrator all.
absl::Status ListMeshes(ServiceState& state, const CallRecord& caller, const v1::ListMeshesRequest& request,
                        v1::ListMeshesResponse& response);
// The mesh is deleted if no claim is left, otherwise kept_for_others is set. PERMISSION_DENIED if the caller has no
// claim.
absl::Status ReleaseMesh(ServiceState& state, const CallRecord& caller, const v1::ReleaseMeshRequest& request,
                         v1::ReleaseMeshResponse& response);
// Removes the mesh whatever claims it has. PERMISSION_DENIED if the caller is no administrator.
absl::Status DeleteMesh(ServiceState& state, const CallRecord& caller, const v1::DeleteMeshRequest& request,
                        v1::DeleteMeshResponse& response);

}  // namespace voxelpipe
