#include "web/exchange.h"

#include "absl/status/statusor.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "calls/head_check.h"
#include "web/http/client_timeout.h"
#include "web/http/web_reply.h"
#include "web/http/web_request.h"
#include "web/method_stream.h"
#include "web/page_files.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

constexpr char kFilePath[] = "/file";
constexpr char kMessageType[] = "application/x-protobuf";

WebReply InWords(unsigned code, std::string text) {
  return {code, "text/plain; charset=utf-8", std::move(text), {}};
}

// Of a body that announces its length.
absl::Status CheckLength(MHD_Connection* connection) {
  uint64_t announced = 0;
  const auto length = HeaderOf(connection, "Content-Length");
  if (!length || !absl::SimpleAtoi(absl::string_view(length->data(), length->size()), &announced) ||
      announced <= uint64_t{kMaxMessageBytes} + kFrameHeadBytes) {
    return absl::OkStatus();
  }
  return absl::ResourceExhaustedError(absl::StrCat("the body has ", announced, " bytes, one message has at most ",
                                                   kMaxMessageBytes,
                                                   "; larger meshes go through gRPC's VoxelizeUpload"));
}

}  // namespace

bool Exchange::asks_for_file() const {
  return path_ == kFilePath;
}

MHD_Result Exchange::Begin(MHD_Connection* connection) {
  const std::optional<MHD_Result> refused = Refuse(connection);
  if (refused) {
    leaves_body_ = HasBody(connection);
    return *refused;
  }
  const ServerOptions& options = web_.state.options;
  MHD_set_connection_option(connection, MHD_CONNECTION_OPTION_TIMEOUT, SecondsOf(options.upload_idle_timeout_ms));
  body_ = std::make_unique<RequestBody>(asks_for_file() ? 0 : kFrameHeadBytes, uint64_t{kMaxMessageBytes},
                                        web_.state.uploads, std::chrono::milliseconds(options.upload_idle_timeout_ms));
  return MHD_YES;
}

std::optional<MHD_Result> Exchange::Refuse(MHD_Connection* connection) {
  const RequestSource source = SourceOf(connection);
  if (absl::Status s = web_.origins.Check(source); !s.ok()) {
    return SendWebReply(connection, PlainError(ToGrpcStatus(s)), "");
  }
  if (web_.origins.IsForeignAllowed(source)) allowed_ = std::string(*source.origin);
  const auto answer = [&](const WebReply& reply) { return SendWebReply(connection, reply, allowed_); };
  if (method_ == "OPTIONS") return answer(PreflightReply());
  if (method_ == "GET" || method_ == "HEAD") {
    const PageFile* const file = FindPageFile(path_);
    if (file == nullptr) return answer(InWords(MHD_HTTP_NOT_FOUND, "there is no such file; the page is /\n"));
    return answer({MHD_HTTP_OK, file->type, std::string(file->text), {}});
  }
  if (method_ != "POST") return answer(InWords(MHD_HTTP_METHOD_NOT_ALLOWED, "GET, HEAD, POST or OPTIONS\n"));

  // These types are not those of forms: a browser asks before a foreign page may send them.
  const auto type = HeaderOf(connection, "Content-Type");
  const bool framed = IsType(type, kGrpcWebType) || IsType(type, "application/grpc-web");
  if (asks_for_file() ? !IsType(type, kMessageType) : !framed) {
    return answer(InWords(MHD_HTTP_UNSUPPORTED_MEDIA_TYPE,
                          absl::StrCat("Content-Type: ", asks_for_file() ? kMessageType : kGrpcWebType, "\n")));
  }
  WebMetadata headers;
  const absl::Status status = CheckCall(connection, headers);
  if (status.ok()) return std::nullopt;
  const grpc::Status error = ToGrpcStatus(status);
  WebReply reply = asks_for_file() ? PlainError(error) : GrpcWebError(error);
  reply.headers.insert(reply.headers.end(), headers.begin(), headers.end());
  return answer(reply);
}

absl::Status Exchange::CheckCall(MHD_Connection* connection, WebMetadata& headers) {
  const absl::StatusOr<Rpc> method = asks_for_file() ? Rpc::kVoxelize : WebMethodOf(path_);
  if (!method.ok()) return method.status();
  absl::StatusOr<BridgeCall::Setup> call = CallOf(web_, connection, path_);
  if (!call.ok()) return call.status();
  if (std::optional<RefusedHead> refused = CheckHead(web_.state, CallerOf(connection), *method)) {
    headers.emplace_back("x-request-id", std::move(refused->request_id));
    return refused->status;
  }
  if (asks_for_file()) {
    if (absl::Status s = AskedFormat(connection).status(); !s.ok()) return s;
  } else {
    call_ = *std::move(call);
  }
  return CheckLength(connection);
}

MHD_Result Exchange::Take(std::string_view piece) {
  return body_ != nullptr && body_->Append(piece) == RequestBody::Took::kGood ? MHD_YES : MHD_NO;
}

MHD_Result Exchange::End(MHD_Connection* connection) {
  if (body_ == nullptr) return MHD_NO;
  const std::unique_ptr<RequestBody> body = std::move(body_);
  if (!asks_for_file()) return AnswerMethod(web_, connection, *call_, *body, allowed_);
  download_ = std::make_unique<ResultDownload>(web_);
  return download_->Answer(connection, *body, allowed_);
}

}  // namespace voxelpipe
