#include "calls/voxelize_mesh_call.h"

#include <memory>
#include <optional>
#include <utility>

#include <google/protobuf/arena.h>

#include "calls/call_setup.h"
#include "reply/raw_message.h"
#include "run/answer_burst.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

VoxelizeMeshCall* VoxelizeMeshCall::Create(ServiceState& state, grpc::CallbackServerContext& server_context,
                                           grpc::ByteBuffer& request) {
  const std::shared_ptr<VoxelizeMeshCall> call(new VoxelizeMeshCall(state, server_context));
  call->KeepAlive(std::shared_ptr<ResultCall>(call, call.get()));
  absl::Status status = MayBegin(call->pass_, call->record_.admission());
  if (status.ok()) status = call->TakeRequest(request);
  if (status.ok()) {
    call->SubmitJob();
  } else {
    call->End(std::move(status));
  }
  return call.get();
}

VoxelizeMeshCall::VoxelizeMeshCall(ServiceState& state, grpc::CallbackServerContext& server_context)
    : ResultCall(state, server_context, Rpc::kVoxelizeMesh, SmallResult::kInOneMessage) {}

absl::Status VoxelizeMeshCall::TakeRequest(grpc::ByteBuffer& message) {
  google::protobuf::Arena arena;
  auto& request = *google::protobuf::Arena::CreateMessage<v1::VoxelizeMeshRequest>(&arena);
  if (absl::Status s = ReadMessage(message, request); !s.ok()) return s;
  if (absl::Status s = TakeConfig(request.config()); !s.ok()) return s;
  return TakePiece(std::move(*request.mutable_mesh()),
                   request.has_crc32c() ? std::optional(request.crc32c()) : std::nullopt);
}

void VoxelizeMeshCall::StartMessage(const grpc::ByteBuffer* message, grpc::WriteOptions options) {
  StartWrite(message, options);
}

void VoxelizeMeshCall::StartLastMessage(const grpc::ByteBuffer* message) {
  const auto send = [this, message, keep = self_] {
    StartWriteAndFinish(message, grpc::WriteOptions(), grpc::Status::OK);
  };
  if (!AnswerBurst::Later(this, send)) send();
}

void VoxelizeMeshCall::FinishCall(const grpc::Status& status) {
  Finish(status);
}

}  // namespace voxelpipe
