#include "observe/http_endpoint.h"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdarg>
#include <cstdio>
#include <new>
#include <string_view>
#include <utility>

#include <microhttpd.h>

#include "absl/strings/str_cat.h"
#include "observe/listen_socket.h"
#include "observe/log.h"
#include "observe/metrics.h"

namespace voxelpipe {
namespace {

constexpr unsigned kSilentSeconds = 2;
constexpr size_t kRequestBytes = 8 << 10;  // of one connection: the headers of request and response
constexpr char kText[] = "text/plain; charset=utf-8";
constexpr char kPrometheusText[] = "text/plain; version=0.0.4; charset=utf-8";

void LogDaemonMessage(void* /*self*/, const char* format, va_list arguments) {
  std::array<char, 300> text{};
  std::vsnprintf(text.data(), text.size(), format, arguments);
  const std::string line(text.data());
  LogMessage(LogLevel::kDebug, "http: " + line.substr(0, line.find('\n')));
}

MHD_Result Send(MHD_Connection* connection, unsigned status, const char* type, std::string_view body) {
  MHD_Response* const response =
      MHD_create_response_from_buffer(body.size(), const_cast<char*>(body.data()),
                                      MHD_RESPMEM_MUST_COPY);  // the parameter is not const, but the body is copied
  if (response == nullptr) return MHD_NO;
  MHD_add_response_header(response, MHD_HTTP_HEADER_CONTENT_TYPE, type);
  MHD_add_response_header(response, MHD_HTTP_HEADER_CACHE_CONTROL, "no-store");
  MHD_add_response_header(response, MHD_HTTP_HEADER_CONNECTION, "close");
  const MHD_Result queued = MHD_queue_response(connection, status, response);
  MHD_destroy_response(response);
  return queued;
}

// Most descriptors of the process are for the service.
unsigned MostConnections() {
  rlimit files{};
  if (getrlimit(RLIMIT_NOFILE, &files) != 0) return 256;
  return unsigned(std::clamp<rlim_t>(files.rlim_cur * 3 / 4, 64, HttpEndpoint::kMaxConnections));
}

}  // namespace

// The callback of the library.
struct HttpAnswers {
  static MHD_Result Answer(void* self, MHD_Connection* connection, const char* url, const char* method_name,
                           const char* /*version*/, const char* /*body*/, size_t* body_bytes, void** /*request*/) {
    *body_bytes = 0;  // ignores request bodies
    try {
      return Answer(*static_cast<HttpEndpoint*>(self), connection, url, method_name);
    } catch (const std::bad_alloc&) {
      return MHD_NO;  // closes the connection
    }
  }

  static MHD_Result Answer(HttpEndpoint& endpoint, MHD_Connection* connection, std::string_view path,
                           std::string_view method) {
    if (method != "GET" && method != "HEAD")
      return Send(connection, MHD_HTTP_METHOD_NOT_ALLOWED, kText, "GET or HEAD\n");
    if (path == "/livez") return Send(connection, MHD_HTTP_OK, kText, "ok\n");
    if (path == "/readyz") {
      const bool ready = endpoint.ready_();
      return Send(connection, ready ? MHD_HTTP_OK : MHD_HTTP_SERVICE_UNAVAILABLE, kText,
                  ready ? "ok\n" : "not serving\n");
    }
    if (path == "/metrics") return Send(connection, MHD_HTTP_OK, kPrometheusText, endpoint.metrics_.Text());
    return Send(connection, MHD_HTTP_NOT_FOUND, kText, "/metrics, /livez and /readyz\n");
  }
};

absl::StatusOr<std::unique_ptr<HttpEndpoint>> HttpEndpoint::Start(const std::string& listen, Metrics& metrics,
                                                                  std::function<bool()> ready) {
  const absl::StatusOr<ListenSocket> socket = ListenOn(listen);
  if (!socket.ok()) return socket.status();
  std::unique_ptr<HttpEndpoint> endpoint(new HttpEndpoint(metrics, std::move(ready)));
  endpoint->daemon_ = MHD_start_daemon(MHD_USE_EPOLL_INTERNAL_THREAD | MHD_USE_ITC | MHD_USE_ERROR_LOG, 0, nullptr,
                                       nullptr, static_cast<MHD_AccessHandlerCallback>(&HttpAnswers::Answer),
                                       endpoint.get(), MHD_OPTION_EXTERNAL_LOGGER, &LogDaemonMessage, nullptr,
                                       MHD_OPTION_LISTEN_SOCKET, socket->descriptor, MHD_OPTION_CONNECTION_LIMIT,
                                       MostConnections(), MHD_OPTION_CONNECTION_TIMEOUT, kSilentSeconds,
                                       MHD_OPTION_CONNECTION_MEMORY_LIMIT, kRequestBytes, MHD_OPTION_END);
  if (endpoint->daemon_ == nullptr) {
    close(socket->descriptor);
    return absl::UnavailableError(absl::StrCat("cannot serve on ", listen));
  }
  endpoint->address_ = socket->address;
  return endpoint;
}

HttpEndpoint::~HttpEndpoint() {
  if (daemon_ != nullptr) MHD_stop_daemon(daemon_);  // and closes the socket
}

}  // namespace voxelpipe
