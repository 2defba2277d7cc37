#include "calls/voxelize_upload_call.h"

#include <optional>
#include <utility>

#include "absl/status/status.h"
#include "calls/call_setup.h"
#include "reply/raw_message.h"

namespace voxelpipe {

VoxelizeUploadCall* VoxelizeUploadCall::Create(ServiceState& state, grpc::CallbackServerContext& server_context) {
  const std::shared_ptr<VoxelizeUploadCall> call(new VoxelizeUploadCall(state, server_context));
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

VoxelizeUploadCall::VoxelizeUploadCall(ServiceState& state, grpc::CallbackServerContext& server_context)
    : ResultCall(state, server_context, Rpc::kVoxelizeUpload) {}

void VoxelizeUploadCall::OnReadDone(bool ok) {
  if (!ok) {
    upload_wait_->End();
    UploadEnded();
    return;
  }
  v1::VoxelizeUploadRequest message;
  absl::Status taken = ReadMessage(read_, message);
  if (taken.ok()) {
    const std::lock_guard lock(mutex_);  // the idle watch may end the call concurrently
    if (end_) return;
    taken = TakeMessage(message);
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

absl::Status VoxelizeUploadCall::TakeMessage(v1::VoxelizeUploadRequest& message) {
  switch (message.message_case()) {
    case v1::VoxelizeUploadRequest::kRequest: return TakeRequest(*message.mutable_request());
    case v1::VoxelizeUploadRequest::kPiece:
      return TakePiece(std::move(*message.mutable_piece()),
                       message.has_crc32c() ? std::optional(message.crc32c()) : std::nullopt);
    default: return absl::InvalidArgumentError("message: neither a request nor a piece");
  }
}

void VoxelizeUploadCall::UploadEnded() {
  if (context_.IsCancelled()) {
    if (context.Check().ok()) context.Cancel();
    End(context.Check());
    return;
  }
  if (!configured_) {
    End(absl::InvalidArgumentError("request: the stream ended without one"));
    return;
  }
  SubmitJob();
}

void VoxelizeUploadCall::StartMessage(const grpc::ByteBuffer* message, grpc::WriteOptions options) {
  StartWrite(message, options);
}

void VoxelizeUploadCall::StartLastMessage(const grpc::ByteBuffer* message) {
  StartWriteAndFinish(message, grpc::WriteOptions(), grpc::Status::OK);
}

void VoxelizeUploadCall::FinishCall(const grpc::Status& status) {
  Finish(status);
}

}  // namespace voxelpipe
