#include "calls/export_file_call.h"

#include <utility>

#include <google/protobuf/arena.h>

#include "export/file_export.h"
#include "reply/file_stream.h"
#include "reply/raw_message.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {

VoxelizeCall* ExportFileCall::Create(ServiceState& state, grpc::CallbackServerContext& server_context,
                                     grpc::ByteBuffer& request) {
  return Begin(std::shared_ptr<ExportFileCall>(new ExportFileCall(state, server_context)), request);
}

ExportFileCall::ExportFileCall(ServiceState& state, grpc::CallbackServerContext& server_context)
    : VoxelizeCall(state, server_context, Rpc::kExportFile) {}

absl::Status ExportFileCall::TakeMessage(grpc::ByteBuffer& bytes) {
  google::protobuf::Arena arena;
  auto& message = *google::protobuf::Arena::CreateMessage<v1::ExportFileRequest>(&arena);
  if (absl::Status s = ReadMessage(bytes, message); !s.ok()) return s;
  const absl::StatusOr<const OutputFormat*> format = ExportFormatNamed(message.format());
  if (!format.ok()) return format.status();
  absl::StatusOr<std::shared_ptr<ExportedFile>> file = ExportedFile::Create(**format, state_.files);
  if (!file.ok()) return file.status();
  file_ = *std::move(file);
  set_export(ExportTo(file_));
  return TakeRequest(*message.mutable_request());
}

std::shared_ptr<ReplyStream> ExportFileCall::ReplyOfExport(const JobOutcome& outcome, bool cached) {
  return std::make_shared<FileStream>(file_, outcome, cached, state_.options.piece_bytes);
}

}  // namespace voxelpipe
