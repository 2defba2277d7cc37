#include "calls/export_file_call.h"

#include <utility>

#include <google/protobuf/arena.h>

#include "absl/strings/str_cat.h"
#include "base/text.h"
#include "calls/call_setup.h"
#include "encode/format_registry.h"
#include "export/file_export.h"
#include "reply/file_stream.h"
#include "reply/raw_message.h"
#include "voxelpipe/v1/voxelization_service.pb.h"

namespace voxelpipe {
namespace {

constexpr size_t kMaxNameBytes = 40;

absl::StatusOr<const OutputFormat*> FormatNamed(const std::string& name) {
  const std::string extension = absl::StrCat(".", name);
  const OutputFormat* const format = name.empty() ? nullptr : FindFormat(extension);
  if (format != nullptr) return format;
  const std::string why(name.empty() ? "" : WhyNotBuilt(extension));
  return absl::InvalidArgumentError(
      why.empty() ? absl::StrCat("format: '", CleanText(name, kMaxNameBytes), "' is none of ", ListFormats(false))
                  : absl::StrCat("format: ", why));
}

}  // namespace

ExportFileCall* ExportFileCall::Create(ServiceState& state, grpc::CallbackServerContext& server_context,
                                       grpc::ByteBuffer& request) {
  const std::shared_ptr<ExportFileCall> call(new ExportFileCall(state, server_context));
  call->KeepAlive(std::shared_ptr<ResultCall>(call, call.get()));
  absl::Status status = MayBegin(call->pass_, call->record_.admission());
  if (status.ok()) status = call->TakeMessage(request);
  if (status.ok()) {
    call->SubmitJob();
  } else {
    call->End(std::move(status));
  }
  return call.get();
}

ExportFileCall::ExportFileCall(ServiceState& state, grpc::CallbackServerContext& server_context)
    : ResultCall(state, server_context, Rpc::kExportFile) {}

absl::Status ExportFileCall::TakeMessage(grpc::ByteBuffer& bytes) {
  google::protobuf::Arena arena;
  auto& message = *google::protobuf::Arena::CreateMessage<v1::ExportFileRequest>(&arena);
  if (absl::Status s = ReadMessage(bytes, message); !s.ok()) return s;
  const absl::StatusOr<const OutputFormat*> format = FormatNamed(message.format());
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

void ExportFileCall::StartMessage(const grpc::ByteBuffer* message, grpc::WriteOptions options) {
  StartWrite(message, options);
}

void ExportFileCall::StartLastMessage(const grpc::ByteBuffer* message) {
  StartWriteAndFinish(message, grpc::WriteOptions(), grpc::Status::OK);
}

}  // namespace voxelpipe
