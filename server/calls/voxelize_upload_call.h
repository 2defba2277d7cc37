// One VoxelizeUpload call: receives the upload, then runs the job.
#pragma once

#include <cstdint>
#include <memory>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "calls/result_call.h"
#include "state/idle_watch.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

class VoxelizeUploadCall final : public grpc::ServerBidiReactor<grpc::ByteBuffer, grpc::ByteBuffer>,
                                 private ResultCall {
 public:
  // The reactor of a new call. `state` must outlive it.
  static VoxelizeUploadCall* Create(ServiceState& state, grpc::CallbackServerContext& server_context);

  void OnReadDone(bool ok) override;
  void OnWriteDone(bool ok) override { WriteDone(ok); }
  void OnCancel() override { Cancelled(); }
  void OnDone() override { Ended(); }
  bool InternalInlineable() override { return kReactAtOnce; }

 private:
  VoxelizeUploadCall(ServiceState& state, grpc::CallbackServerContext& server_context);

  // With mutex_ held.
  absl::Status TakeMessage(v1::VoxelizeUploadRequest& message);
  void UploadEnded();

  void StartMessage(const grpc::ByteBuffer* message, grpc::WriteOptions options) override;
  void StartLastMessage(const grpc::ByteBuffer* message) override;
  void FinishCall(const grpc::Status& status) override;

  grpc::ByteBuffer read_;
  uint64_t upload_bytes_seen_ = 0;  // at the start of the wait for more
  std::unique_ptr<IdleWatch::Wait> upload_wait_;
};

}  // namespace voxelpipe
