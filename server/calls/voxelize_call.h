// One Voxelize call: one message in, then the job.
#pragma once

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "calls/result_call.h"

namespace voxelpipe {

// A small result costs one hand-over: the thread that ends the job, usually a worker, sends it and finishes the call.
class VoxelizeCall final : public grpc::ServerWriteReactor<grpc::ByteBuffer>, private ResultCall {
 public:
  // The reactor of a new call. `state` must outlive it; `request` is consumed immediately.
  static VoxelizeCall* Create(ServiceState& state, grpc::CallbackServerContext& server_context,
                              grpc::ByteBuffer& request);

  void OnWriteDone(bool ok) override { WriteDone(ok); }
  void OnCancel() override { Cancelled(); }
  void OnDone() override { Ended(); }
  bool InternalInlineable() override { return kReactAtOnce; }

 private:
  VoxelizeCall(ServiceState& state, grpc::CallbackServerContext& server_context);

  absl::Status TakeMessage(grpc::ByteBuffer& message);

  void StartMessage(const grpc::ByteBuffer* message, grpc::WriteOptions options) override;
  void StartLastMessage(const grpc::ByteBuffer* message) override;
  void FinishCall(const grpc::Status& status) override;
};

}  // namespace voxelpipe
