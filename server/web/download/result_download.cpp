#include "web/download/result_download.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/wire_format_lite.h>
#include <grpcpp/support/proto_buffer_reader.h>

#include "absl/strings/str_cat.h"
#include "base/text.h"
#include "encode/atomic_file.h"
#include "encode/format_registry.h"
#include "encode/png_preview.h"
#include "job/memory_sink.h"
#include "observe/log.h"
#include "reply/raw_message.h"
#include "web/download/result_feed.h"
#include "web/download/temporary_folder.h"
#include "web/http/bridge_call.h"
#include "web/http/client_socket.h"
#include "web/http/client_timeout.h"
#include "web/http/web_reply.h"
#include "web/http/web_request.h"
#include "wire/request.h"
#include "wire/response.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

using google::protobuf::internal::WireFormatLite;

constexpr size_t kMaxFormatBytes = 40;
constexpr size_t kMaxWarningLines = 10;
constexpr std::chrono::milliseconds kFileRetryAfter{2000};

// The config of a VoxelizeMeshRequest, without a copy of its mesh. Does not consume `message`.
absl::StatusOr<v1::VoxelizeConfig> ReadConfig(grpc::ByteBuffer& message) {
  if (absl::Status s = CheckSettingsBytes(message, kMeshFields<v1::VoxelizeMeshRequest>); !s.ok()) return s;
  constexpr uint32_t kConfig =
      WireFormatLite::MakeTag(v1::VoxelizeMeshRequest::kConfigFieldNumber, WireFormatLite::WIRETYPE_LENGTH_DELIMITED);
  grpc::ProtoBufferReader reader(&message);
  google::protobuf::io::CodedInputStream in(&reader);
  v1::VoxelizeConfig config;
  bool good = reader.status().ok();
  while (good) {
    const uint32_t tag = in.ReadTag();
    if (tag == 0) break;
    if (tag == kConfig) {
      std::string bytes;
      int length = 0;
      good = in.ReadVarintSizeAsInt(&length) && length <= int(kMaxSettingsBytes) && in.ReadString(&bytes, length) &&
             config.MergeFromString(bytes);
    } else {
      good = WireFormatLite::SkipField(&in, tag);
    }
  }
  if (!good || !in.ConsumedEntireMessage()) return absl::InvalidArgumentError("message: not a VoxelizeMeshRequest");
  return config;
}

// Where a result goes: the writer of a format, or memory for a picture of it.
struct Destination {
  std::unique_ptr<ResultFile> file;
  MemorySink memory;
  ResultSink& sink() {
    if (file) return *file;
    return memory;
  }
};

absl::Status EndOf(Destination& to, const v1::Summary& summary, const std::string& path, const JobContext& job) {
  if (!to.file) return WritePreview(to.memory.Take(), path, {}, &job);
  to.file->set_sha256(summary.content_sha256());
  return to.file->Commit();
}

WebMetadata WarningHeaders(const v1::Summary& summary) {
  const WarningList warnings = ReadWarnings(summary);
  WebMetadata headers;
  const size_t lines = std::min(kMaxWarningLines, warnings.kept().size());
  for (size_t i = 0; i < lines; ++i) {
    headers.emplace_back("voxelpipe-warning", PercentEncoded(warnings.kept()[i].Line()));
  }
  const uint64_t further = warnings.kept().size() - lines + warnings.left_out();
  if (further > 0) headers.emplace_back("voxelpipe-warning", absl::StrCat(further, " further warnings"));
  return headers;
}

// What a caller may know of an error in a file of this machine.
absl::Status WithoutPaths(absl::Status status) {
  if (!IsOutputError(status)) return status;
  LogMessage(LogLevel::kWarn, absl::StrCat("web: ", std::string(status.message())));
  return absl::Status(status.code(), "the server cannot write its temporary file; its log has the reason");
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
    return SendWebReply(connection, PlainError(ToGrpcStatus(WithoutPaths(file.status()))), allowed);
  }
  WebReply head{MHD_HTTP_OK, "application/octet-stream", "", std::move(file->warnings)};
  head.headers.emplace_back("Content-Disposition", absl::StrCat("attachment; filename=\"", file->name, "\""));
  MHD_Response* const response = MHD_create_response_from_fd64(file->bytes, file->descriptor);
  if (response == nullptr) close(file->descriptor);
  return QueueWebReply(connection, response, head, allowed);
}

absl::StatusOr<ResultDownload::File> ResultDownload::Make(MHD_Connection* connection, RequestBody& body) {
  if (!body.status().ok()) return body.status();
  const char* const asked = MHD_lookup_connection_value(connection, MHD_GET_ARGUMENT_KIND, "format");
  const std::string name = asked == nullptr ? "" : asked;
  const OutputFormat* const format = FindFormat("." + name);
  if (format == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrCat("format: '", CleanText(name, kMaxFormatBytes), "' is not one of ", ListFormats(false)));
  }
  grpc::ByteBuffer message = body.Take();
  const absl::StatusOr<v1::VoxelizeConfig> config = ReadConfig(message);
  if (!config.ok()) return config.status();
  const absl::StatusOr<ParsedConfig> parsed = ParseConfig(*config);
  if (!parsed.ok()) return parsed.status();
  if (parsed->settings.compression != Compression::kNone) {
    return absl::InvalidArgumentError("config.compression: a file needs NONE; its format compresses by itself");
  }
  const VoxelizeRequest& request = parsed->request;
  if (absl::Status s = CheckHolds(format->extension, request.result, request.targets.size()); !s.ok()) return s;

  struct Running {
    std::atomic<int>& count;
    const bool may = count.fetch_add(1) < kMaxRuns;
    ~Running() { count.fetch_sub(1); }
  } const running{web_.file_runs};
  if (!running.may) return BusyError("too many files are being made at the same time", kFileRetryAfter);

  absl::StatusOr<BridgeCall::Setup> setup = CallOf(web_, connection, absl::StrCat(kServicePath, "VoxelizeMesh"));
  if (!setup.ok()) return setup.status();
  JobContext job;
  if (setup->timeout) {
    job.set_deadline(JobContext::Clock::now() +
                     std::chrono::duration_cast<JobContext::Clock::duration>(*setup->timeout));
  }
  const absl::StatusOr<TemporaryFolder> folder = TemporaryFolder::Create();
  if (!folder.ok()) return folder.status();
  const std::string file_name = absl::StrCat("result", std::string(format->extension));
  const std::string path = absl::StrCat(folder->path(), "/", file_name);
  BudgetShare memory(web_.state.working);  // of a result that is collected first
  const auto too_large = [&] {
    return absl::ResourceExhaustedError(absl::StrCat("the file does not fit into what is left of --web-file-bytes, ",
                                                     BytesText(web_.files.limit()), " in all"));
  };
  // The file is written by code that knows no limit, so its size is looked at while it grows.
  std::atomic<bool> grew_too_large{false};
  const auto charge = [&] {
    const uint64_t bytes = folder->Bytes();
    return bytes <= share_.bytes() || share_.TryGrow(bytes - share_.bytes());
  };
  std::optional<WebWatches::Watch> watch(std::in_place, web_.watches, [&] {
    if (!charge()) grew_too_large = true;
    if (grew_too_large || HasHungUp(setup->client)) job.Cancel();
  });

  Destination to;
  if (!format->picture()) to.file = format->open(path, &job);
  ResultFeed feed(request, to.sink(), [&](const ResultHeader& header) -> absl::Status {
    const uint64_t bytes = BytesOf(header);
    if (bytes > web_.files.limit()) return too_large();
    if (!(format->picture() || format->whole) || memory.TryGrow(bytes)) return absl::OkStatus();
    return BusyError("the memory for this result is in use", kFileRetryAfter);
  });
  absl::Status status;
  {
    BridgeCall call(web_.channel, *setup, std::move(message));
    for (grpc::ByteBuffer next; status.ok() && call.Next(next);) {
      status = feed.Take(next);
      if (status.ok()) status = job.Check();
    }
    if (status.ok()) status = FromGrpcStatus(call.Finish());
  }
  if (status.ok()) status = feed.Check();
  if (status.ok()) status = EndOf(to, feed.summary(), path, job);
  absl::StatusOr<std::string> made = std::string();
  if (status.ok()) {
    made = folder->OneFile(file_name, job);
    status = made.status();
  }
  watch.reset();
  if (grew_too_large || (status.ok() && !charge())) return too_large();
  if (!status.ok()) return status;

  File file;
  file.descriptor = open(made->c_str(), O_RDONLY | O_CLOEXEC);
  struct stat facts {};
  if (file.descriptor < 0 || fstat(file.descriptor, &facts) != 0) {
    const int error = errno;
    if (file.descriptor >= 0) close(file.descriptor);
    return OutputError(error, absl::StrCat("cannot read '", *made, "'"));
  }
  file.bytes = uint64_t(facts.st_size);
  share_.ShrinkTo(file.bytes);  // the folder is removed; the open file stays until it is sent
  file.name = std::filesystem::path(*made).filename().string();
  file.warnings = WarningHeaders(feed.summary());
  return file;
}

}  // namespace voxelpipe
