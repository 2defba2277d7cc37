#include "web/http/web_reply.h"

#include "absl/strings/str_cat.h"
#include "web/http/frames.h"

namespace voxelpipe {
namespace {

// The page loads nothing but its own files and talks to nothing but this port. The viewer sets styles by itself.
constexpr char kContentPolicy[] =
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self'; img-src 'self' blob: "
    "data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

constexpr unsigned kClientClosed = 499;  // as proxies log it; the client is gone

unsigned HttpCodeOf(grpc::StatusCode code) {
  switch (code) {
    case grpc::StatusCode::OK: return MHD_HTTP_OK;
    case grpc::StatusCode::CANCELLED: return kClientClosed;
    case grpc::StatusCode::INVALID_ARGUMENT:
    case grpc::StatusCode::OUT_OF_RANGE:
    case grpc::StatusCode::FAILED_PRECONDITION: return MHD_HTTP_BAD_REQUEST;
    case grpc::StatusCode::UNAUTHENTICATED: return MHD_HTTP_UNAUTHORIZED;
    case grpc::StatusCode::PERMISSION_DENIED: return MHD_HTTP_FORBIDDEN;
    case grpc::StatusCode::NOT_FOUND: return MHD_HTTP_NOT_FOUND;
    case grpc::StatusCode::RESOURCE_EXHAUSTED: return MHD_HTTP_TOO_MANY_REQUESTS;
    case grpc::StatusCode::UNIMPLEMENTED: return MHD_HTTP_NOT_IMPLEMENTED;
    case grpc::StatusCode::UNAVAILABLE: return MHD_HTTP_SERVICE_UNAVAILABLE;
    case grpc::StatusCode::DEADLINE_EXCEEDED: return MHD_HTTP_GATEWAY_TIMEOUT;
    default: return MHD_HTTP_INTERNAL_SERVER_ERROR;
  }
}

}  // namespace

void AddWebHeaders(MHD_Response* response, const std::string& type, const std::string& allowed) {
  const auto add = [response](const char* name, const std::string& value) {
    MHD_add_response_header(response, name, value.c_str());
  };
  if (!type.empty()) add("Content-Type", type);
  add("Cache-Control", "no-store");
  add("Content-Security-Policy", kContentPolicy);
  add("X-Content-Type-Options", "nosniff");
  add("Referrer-Policy", "no-referrer");
  add("Cross-Origin-Opener-Policy", "same-origin");
  add("Cross-Origin-Resource-Policy", allowed.empty() ? "same-origin" : "cross-origin");
  add("Vary", "Origin");
  // One request a connection: nothing of one can be taken for the next, and idle connections end.
  add("Connection", "close");
  if (allowed.empty()) return;
  add("Access-Control-Allow-Origin", allowed);
  add("Access-Control-Expose-Headers",
      "content-disposition, grpc-message, grpc-status, grpc-status-details-bin, voxelpipe-summary-bin, "
      "voxelpipe-warning, x-request-id");
}

MHD_Result QueueWebReply(MHD_Connection* connection, MHD_Response* response, const WebReply& reply,
                         const std::string& allowed) {
  if (response == nullptr) return MHD_NO;
  AddWebHeaders(response, reply.type, allowed);
  for (const auto& [name, value] : reply.headers) MHD_add_response_header(response, name.c_str(), value.c_str());
  const MHD_Result queued = MHD_queue_response(connection, reply.code, response);
  MHD_destroy_response(response);
  return queued;
}

MHD_Result SendWebReply(MHD_Connection* connection, const WebReply& reply, const std::string& allowed) {
  // The parameter is not const, but the body is copied.
  char* const body = const_cast<char*>(reply.body.data());
  return QueueWebReply(connection, MHD_create_response_from_buffer(reply.body.size(), body, MHD_RESPMEM_MUST_COPY),
                       reply, allowed);
}

WebReply GrpcWebError(const grpc::Status& status) {
  return {MHD_HTTP_OK, kGrpcWebType, TrailerFrame(status), {}};
}

WebReply PlainError(const grpc::Status& status) {
  WebReply reply{HttpCodeOf(status.error_code()), "text/plain; charset=utf-8", status.error_message() + "\n", {}};
  reply.headers.emplace_back("grpc-status", absl::StrCat(int(status.error_code())));
  reply.headers.emplace_back("grpc-message", PercentEncoded(status.error_message()));
  if (!status.error_details().empty()) {
    reply.headers.emplace_back("grpc-status-details-bin", BinaryValue(status.error_details()));
  }
  return reply;
}

WebReply PreflightReply() {
  WebReply reply{MHD_HTTP_NO_CONTENT, "", "", {}};
  reply.headers.emplace_back("Access-Control-Allow-Methods", "POST");
  reply.headers.emplace_back(
      "Access-Control-Allow-Headers",
      "authorization, content-type, grpc-timeout, traceparent, x-grpc-web, x-request-id, x-user-agent");
  reply.headers.emplace_back("Access-Control-Max-Age", "600");  // seconds
  return reply;
}

}  // namespace voxelpipe
