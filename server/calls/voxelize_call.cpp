#include "calls/voxelize_call.h"

#include <optional>
#include <utility>

#include "absl/status/status.h"
#include "calls/call_setup.h"
#include "reply/raw_message.h"

namespace voxelpipe {

VoxelizeCall* VoxelizeCall::Create(ServiceState& state, grpc::CallbackServerContext& server_context) {
  const std::shared_ptr<VoxelizeCall> call(new VoxelizeCall(state, server_context));
  call->KeepAlive(std::shared_ptr<ResultCall>(call, call.get()));
  call->upload_wait_ = call->WaitForClient(state.options.upload_idle_timeout_ms, "sent too little of its mesh");
  if (absl::Status status = MayBegin(call->pass_, call->record_.admission()); !status.ok()) {
    call->End(std::move(status));
  } else {
    call->upload_wait_->Begin();
    call->StartRead(&call->read_);
  }
  return call.get();
}

VoxelizeCall::VoxelizeCall(ServiceState& state, grpc::CallbackServerContext& server_context)
    : ResultCall(state, server_context, Rpc::kVoxelize, SmallResult::kInPieces) {}

void VoxelizeCall::OnReadDone(bool ok) {
  if (!ok) {
    upload_wait_->End();
    UploadEnded();
    return;
  }
  v1::VoxelizeRequest request;
  absl::Status taken = ReadMessage(read_, request);
  if (taken.ok()) {
    const std::lock_guard lock(mutex_);  // the idle watch may end the call concurrently
    if (end_) return;
    taken = TakeMessage(request);
  }
  if (!taken.ok()) {
    upload_wait_->End();
    End(std::move(taken));
    return;
  }
  if (record_.bytes_in - upload_bytes_seen_ >= kMinUploadBytes) {
    upload_bytes_seen_ = record_.bytes_in;
    upload_wait_->Begin();
  }
  StartRead(&read_);
}

absl::Status VoxelizeCall::TakeMessage(v1::VoxelizeRequest& request) {
  switch (request.message_case()) {
    case v1::VoxelizeRequest::kConfig: return TakeConfig(request.config());
    case v1::VoxelizeRequest::kMeshPiece:
      return TakePiece(std::move(*request.mutable_mesh_piece()),
                       request.has_crc32c() ? std::optional(request.crc32c()) : std::nullopt);
    default: return absl::InvalidArgumentError("message: neither a config nor a mesh piece");
  }
}

void VoxelizeCall::UploadEnded() {
  if (context_.IsCancelled()) {
    if (context.Check().ok()) context.Cancel();
    End(context.Check());
    return;
  }
  if (!configured_) {
    End(absl::InvalidArgumentError("config: the stream ended without one"));
    return;
  }
  SubmitJob();
}

void VoxelizeCall::StartMessage(const grpc::ByteBuffer* message, grpc::WriteOptions options) {
  StartWrite(message, options);
}

void VoxelizeCall::StartLastMessage(const grpc::ByteBuffer* message) {
  StartWriteAndFinish(message, grpc::WriteOptions(), grpc::Status::OK);
}

void VoxelizeCall::FinishCall(const grpc::Status& status) {
  Finish(status);
}

}  // namespace voxelpipe
