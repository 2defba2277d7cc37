// One VoxelizeMesh call: one message in, then the job.
#pragma once

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "calls/react_at_once.h"
#include "calls/result_call.h"

namespace voxelpipe {

// A small result costs one hand-over: the thread that ends the job, usually a worker, sends it and finishes the call.
class VoxelizeMeshCall final : public grpc::ServerWriteReactor<grpc::ByteBuffer>, private ResultCall {
 public:
  // The reactor of a new call. `state` must outlive it; `request` is consumed immediately.
  static VoxelizeMeshCall* Create(ServiceState& state, grpc::CallbackServerContext& server_context,
                                  grpc::ByteBuffer& request);

  void OnWriteDone(bool ok) override { WriteDone(ok); }
  void OnCancel() override { Cancelled(); }
  void OnDone() override { Ended(); }
  bool InternalInlineable() override { return kReactAtOnce; }

 private:
  VoxelizeMeshCall(ServiceState& state, grpc::CallbackServerContext& server_context);

  absl::Status TakeRequest(grpc::ByteBuffer& message);

  void StartMessage(const grpc::ByteBuffer* message, grpc::WriteOptions options) override;
  void StartLastMessage(const grpc::ByteBuffer* message) override;
  void FinishCall(const grpc::Status& status) override;
};

}  // namespace voxelpipe
