#include "web/download/result_download.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <memory>
#include <utility>

#include <grpcpp/impl/codegen/proto_utils.h>

#include "absl/strings/str_cat.h"
#include "encode/atomic_file.h"
#include "encode/format_registry.h"
#include "voxelpipe/v1/voxelization_service.pb.h"
#include "web/download/file_export.h"
#include "web/http/bridge_call.h"
#include "web/http/client_timeout.h"
#include "web/http/web_reply.h"
#include "web/http/web_request.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

constexpr size_t kMaxWarningLines = 10;

WebMetadata WarningHeaders(const WarningList& warnings) {
  WebMetadata headers;
  const size_t lines = std::min(kMaxWarningLines, warnings.kept().size());
  for (size_t i = 0; i < lines; ++i) {
    headers.emplace_back("voxelpipe-warning", PercentEncoded(warnings.kept()[i].Line()));
  }
  const uint64_t further = warnings.kept().size() - lines + warnings.left_out();
  if (further > 0) headers.emplace_back("voxelpipe-warning", absl::StrCat(further, " further warnings"));
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
  int descriptor = -1;
  uint64_t bytes = 0;
  std::string name;
  WebMetadata warnings;
};

ResultDownload::ResultDownload(WebContext& web) : web_(web), share_(web.files) {}

ResultDownload::~ResultDownload() = default;

MHD_Result ResultDownload::Answer(MHD_Connection* connection, RequestBody& body, const std::string& allowed) {
  absl::StatusOr<File> file = absl::InternalError("");
  {
    const ClientTimeoutPause pause(connection, SecondsOf(web_.state.options.stall_timeout_ms));
    file = Make(connection, body);
  }
  if (!file.ok()) {
    share_.ShrinkTo(0);
    return SendWebReply(connection, PlainError(ToGrpcStatus(file.status())), allowed);
  }
  WebReply head{MHD_HTTP_OK, "application/octet-stream", "", std::move(file->warnings)};
  head.headers.emplace_back("Content-Disposition", absl::StrCat("attachment; filename=\"", file->name, "\""));
  MHD_Response* const response = MHD_create_response_from_fd64(file->bytes, file->descriptor);
  if (response == nullptr) close(file->descriptor);
  return QueueWebReply(connection, response, head, allowed);
}

absl::StatusOr<ResultDownload::File> ResultDownload::Make(MHD_Connection* connection, RequestBody& body) {
  if (!body.status().ok()) return body.status();
  const absl::StatusOr<const OutputFormat*> format = AskedFormat(connection);
  if (!format.ok()) return format.status();
  absl::StatusOr<BridgeCall::Setup> setup = CallOf(web_, connection, absl::StrCat(kServicePath, "VoxelizeMesh"));
  if (!setup.ok()) return setup.status();
  absl::StatusOr<TemporaryFolder> folder = TemporaryFolder::Create();
  if (!folder.ok()) return WithoutPaths(folder.status());
  const std::shared_ptr<ExportedFile> exported(
      new ExportedFile{**format, web_.files.limit(), *std::move(folder), "", {}});
  const ResultExports::Offer offer(web_.state.exports, ExportTo(exported));
  setup->metadata.emplace_back(ResultExports::kKey, offer.ticket());

  // The file is written by code that knows no limit, so its size is looked at while it grows.
  const auto charge = [&] {
    const uint64_t bytes = exported->folder.Bytes();
    return bytes <= share_.bytes() || share_.TryGrow(bytes - share_.bytes());
  };
  bool grew_too_large = false;
  absl::StatusOr<v1::Summary> summary = absl::InternalError("");
  {
    BridgeCall call(web_.channel, *setup, body.Take(), [&] { return !(grew_too_large = !charge()); });
    summary = SummaryOf(call);
  }
  if (grew_too_large || (summary.ok() && !charge())) return FileTooLarge(web_.files.limit());
  if (!summary.ok()) return summary.status();

  File file;
  file.descriptor = open(exported->path.c_str(), O_RDONLY | O_CLOEXEC);
  struct stat facts {};
  if (file.descriptor < 0 || fstat(file.descriptor, &facts) != 0) {
    const int error = errno;
    if (file.descriptor >= 0) close(file.descriptor);
    return WithoutPaths(OutputError(error, absl::StrCat("cannot read '", exported->path, "'")));
  }
  file.bytes = uint64_t(facts.st_size);
  share_.ShrinkTo(file.bytes);  // the folder is removed; the open file stays until it is sent
  file.name = std::filesystem::path(exported->path).filename().string();
  WarningList warnings = ReadWarnings(*summary);
  warnings.Append(exported->warnings);
  file.warnings = WarningHeaders(warnings);
  return file;
}

}  // namespace voxelpipe
