#include "web/download/result_download.h"

#include <unistd.h>

#include <algorithm>
#include <memory>
#include <utility>

#include <grpcpp/impl/codegen/proto_utils.h>

#include "absl/strings/str_cat.h"
#include "encode/format_registry.h"
#include "export/file_export.h"
#include "voxelpipe/v1/voxelization_service.pb.h"
#include "web/http/bridge_call.h"
#include "web/http/client_timeout.h"
#include "web/http/web_reply.h"
#include "web/http/web_request.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

constexpr size_t kMaxWarnings = 10;  // that headers hold: browsers take some 256 KiB of them

// For people the warnings as lines; for programs the summary with the same warnings, `warnings` in place of its own.
WebMetadata HeadersOf(v1::Summary summary, const WarningList& warnings) {
  WebMetadata headers;
  summary.clear_warnings();
  const size_t lines = std::min(kMaxWarnings, warnings.kept().size());
  for (size_t i = 0; i < lines; ++i) {
    headers.emplace_back("voxelpipe-warning", PercentEncoded(warnings.kept()[i].Line()));
    WriteTo(warnings.kept()[i], *summary.add_warnings());
  }
  const uint64_t further = warnings.kept().size() - lines + warnings.left_out();
  if (further > 0) headers.emplace_back("voxelpipe-warning", absl::StrCat(further, " further warnings"));
  summary.set_warnings_left_out(int64_t(further));
  headers.emplace_back("voxelpipe-summary-bin", BinaryValue(summary.SerializeAsString()));
  return headers;
}

// Waits for the end of a call whose result is exported. Out: its summary.
absl::StatusOr<v1::Summary> SummaryOf(BridgeCall& call) {
  v1::VoxelizeResponse last;
  for (grpc::ByteBuffer next; call.Next(next); next.Clear()) {
    if (!grpc::SerializationTraits<v1::VoxelizeResponse>::Deserialize(&next, &last).ok()) {
      return absl::InternalError("a message of the service cannot be read");
    }
  }
  if (absl::Status s = FromGrpcStatus(call.Finish()); !s.ok()) return s;
  if (!last.has_summary()) return absl::InternalError("the service sent no summary");
  return std::move(*last.mutable_summary());
}

}  // namespace

struct ResultDownload::File {
  ExportedFile::Open open;
  WebMetadata headers;
};

ResultDownload::ResultDownload(WebContext& web) : web_(web) {}

ResultDownload::~ResultDownload() = default;

MHD_Result ResultDownload::Answer(MHD_Connection* connection, RequestBody& body, const std::string& allowed) {
  absl::StatusOr<File> file = absl::InternalError("");
  {
    const ClientTimeoutPause pause(connection, SecondsOf(web_.state.options.stall_timeout_ms));
    file = Make(connection, body);
  }
  if (!file.ok()) {
    exported_.reset();
    return SendWebReply(connection, PlainError(ToGrpcStatus(file.status())), allowed);
  }
  WebReply head{MHD_HTTP_OK, "application/octet-stream", "", std::move(file->headers)};
  head.headers.emplace_back("Content-Disposition", absl::StrCat("attachment; filename=\"", file->open.name, "\""));
  MHD_Response* const response = MHD_create_response_from_fd64(file->open.bytes, file->open.descriptor);
  if (response == nullptr) close(file->open.descriptor);
  return QueueWebReply(connection, response, head, allowed);
}

absl::StatusOr<ResultDownload::File> ResultDownload::Make(MHD_Connection* connection, RequestBody& body) {
  if (!body.status().ok()) return body.status();
  const absl::StatusOr<const OutputFormat*> format = AskedFormat(connection);
  if (!format.ok()) return format.status();
  absl::StatusOr<BridgeCall::Setup> setup = CallOf(web_, connection, absl::StrCat(kServicePath, "Voxelize"));
  if (!setup.ok()) return setup.status();
  absl::StatusOr<std::shared_ptr<ExportedFile>> exported = ExportedFile::Create(**format, web_.state.files);
  if (!exported.ok()) return exported.status();
  exported_ = *std::move(exported);
  const ResultExports::Offer offer(web_.state.exports, ExportTo(exported_));
  setup->metadata.emplace_back(ResultExports::kKey, offer.ticket());
  absl::StatusOr<v1::Summary> summary = absl::InternalError("");
  {
    BridgeCall call(web_.channel, *setup, body.Take());
    summary = SummaryOf(call);
  }
  if (!summary.ok()) return summary.status();
  absl::StatusOr<ExportedFile::Open> open = exported_->Take();
  if (!open.ok()) return open.status();
  WarningList warnings = ReadWarnings(*summary);
  warnings.Append(exported_->warnings);
  return File{*std::move(open), HeadersOf(*std::move(summary), warnings)};
}

}  // namespace voxelpipe
