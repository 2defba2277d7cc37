// One Voxelize call: one message in, then the job.
#pragma once

#include <memory>

#include <grpcpp/grpcpp.h>

#include "absl/status/status.h"
#include "calls/result_call.h"

namespace voxelpipe {

// A small result costs one hand-over: the thread that ends the job, usually a worker, sends it and finishes the call.
class VoxelizeCall : public grpc::ServerWriteReactor<grpc::ByteBuffer>, protected ResultCall {
 public:
  // The reactor of a new call. `state` must outlive it; `request` is consumed immediately.
  static VoxelizeCall* Create(ServiceState& state, grpc::CallbackServerContext& server_context,
                              grpc::ByteBuffer& request);

  void OnWriteDone(bool ok) override { WriteDone(ok); }
  void OnCancel() override { Cancelled(); }
  void OnDone() override { Ended(); }
  bool InternalInlineable() override { return kReactAtOnce; }

 protected:
  VoxelizeCall(ServiceState& state, grpc::CallbackServerContext& server_context, Rpc rpc);
  // Takes the message of a new call.
  static VoxelizeCall* Begin(const std::shared_ptr<VoxelizeCall>& call, grpc::ByteBuffer& message);

 private:
  // Consumes the message, and calls TakeRequest with the request in it.
  virtual absl::Status TakeMessage(grpc::ByteBuffer& bytes);

  void StartMessage(const grpc::ByteBuffer* message, grpc::WriteOptions options) override;
  void StartLastMessage(const grpc::ByteBuffer* message) override;
  void FinishCall(const grpc::Status& status) override;
};

}  // namespace voxelpipe
