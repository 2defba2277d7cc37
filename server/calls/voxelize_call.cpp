#include "calls/voxelize_call.h"

#include <memory>
#include <optional>
#include <utility>

#include <google/protobuf/arena.h>

#include "calls/call_setup.h"
#include "reply/raw_message.h"
#include "run/answer_burst.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

VoxelizeCall* VoxelizeCall::Create(ServiceState& state, grpc::CallbackServerContext& server_context,
                                   grpc::ByteBuffer& request) {
  return Begin(std::shared_ptr<VoxelizeCall>(new VoxelizeCall(state, server_context, Rpc::kVoxelize)), request);
}

VoxelizeCall::VoxelizeCall(ServiceState& state, grpc::CallbackServerContext& server_context, Rpc rpc)
    : ResultCall(state, server_context, rpc) {}

VoxelizeCall* VoxelizeCall::Begin(const std::shared_ptr<VoxelizeCall>& call, grpc::ByteBuffer& message) {
  call->KeepAlive(std::shared_ptr<ResultCall>(call, call.get()));
  absl::Status status = MayBegin(call->pass_, call->record_.admission());
  if (status.ok()) status = call->TakeMessage(message);
  if (status.ok()) {
    call->SubmitJob();
  } else {
    call->End(std::move(status));
  }
  return call.get();
}

absl::Status VoxelizeCall::TakeMessage(grpc::ByteBuffer& bytes) {
  google::protobuf::Arena arena;
  auto& request = *google::protobuf::Arena::CreateMessage<v1::VoxelizeRequest>(&arena);
  if (absl::Status s = ReadMessage(bytes, request); !s.ok()) return s;
  return TakeRequest(request);
}

void VoxelizeCall::StartMessage(const grpc::ByteBuffer* message, grpc::WriteOptions options) {
  StartWrite(message, options);
}

void VoxelizeCall::StartLastMessage(const grpc::ByteBuffer* message) {
  const auto send = [this, message, keep = self_] {
    StartWriteAndFinish(message, grpc::WriteOptions(), grpc::Status::OK);
  };
  if (!AnswerBurst::Later(this, send)) send();
}

void VoxelizeCall::FinishCall(const grpc::Status& status) {
  Finish(status);
}

}  // namespace voxelpipe
