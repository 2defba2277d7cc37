#include "observe/http_endpoint.h"

#include <netdb.h>
#include <netinet/in.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdarg>
#include <cstdio>
#include <cstring>
#include <memory>
#include <new>
#include <string_view>
#include <utility>

#include <microhttpd.h>
#include <spdlog/spdlog.h>

#include "absl/strings/str_cat.h"
#include "observe/http_status.h"
#include "observe/metrics.h"

namespace voxelpipe {
namespace {

constexpr unsigned kSilentSeconds = 2;
constexpr size_t kRequestBytes = 8 << 10;  // of one connection: the headers of request and response
constexpr int kBacklog = 1024;
constexpr char kText[] = "text/plain; charset=utf-8";
constexpr char kPrometheusText[] = "text/plain; version=0.0.4; charset=utf-8";

void LogMessage(void* /*self*/, const char* format, va_list arguments) {
  std::array<char, 300> text{};
  std::vsnprintf(text.data(), text.size(), format, arguments);
  spdlog::debug("http: {}", std::string_view(text.data()).substr(0, std::string_view(text.data()).find('\n')));
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

// A listening socket, or -1 with errno.
int Listen(const std::string& host, int port) {
  addrinfo hints{};
  hints.ai_flags = AI_PASSIVE;
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_family = host.empty() ? AF_INET : AF_UNSPEC;
  addrinfo* found = nullptr;
  if (getaddrinfo(host.empty() ? nullptr : host.c_str(), std::to_string(port).c_str(), &hints, &found) != 0) {
    errno = EADDRNOTAVAIL;
    return -1;
  }
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> addresses(found, &freeaddrinfo);
  int wrong = EADDRNOTAVAIL;
  for (const addrinfo* at = addresses.get(); at != nullptr; at = at->ai_next) {
    const int fd = socket(at->ai_family, at->ai_socktype | SOCK_CLOEXEC | SOCK_NONBLOCK, at->ai_protocol);
    if (fd < 0) {
      wrong = errno;
      continue;
    }
    const int on = 1;  // a restarted server can bind its port
    setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    if (at->ai_family == AF_INET6) setsockopt(fd, IPPROTO_IPV6, IPV6_V6ONLY, &on, sizeof on);
    if (bind(fd, at->ai_addr, at->ai_addrlen) == 0 && listen(fd, kBacklog) == 0) return fd;
    wrong = errno;
    close(fd);
  }
  errno = wrong;
  return -1;
}

int PortOf(int fd) {
  sockaddr_storage bound{};
  socklen_t size = sizeof bound;
  if (getsockname(fd, reinterpret_cast<sockaddr*>(&bound), &size) != 0) return 0;
  return ntohs(bound.ss_family == AF_INET6 ? reinterpret_cast<const sockaddr_in6&>(bound).sin6_port
                                           : reinterpret_cast<const sockaddr_in&>(bound).sin_port);
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
  std::string host;
  int port = 0;
  if (!SplitHostPort(listen, host, port)) return absl::InvalidArgumentError(absl::StrCat("no HOST:PORT: ", listen));
  const int fd = Listen(host, port);
  if (fd < 0) return absl::UnavailableError(absl::StrCat("cannot listen on ", listen, ": ", std::strerror(errno)));
  std::unique_ptr<HttpEndpoint> endpoint(new HttpEndpoint(metrics, std::move(ready)));
  port = PortOf(fd);
  endpoint->daemon_ = MHD_start_daemon(
      MHD_USE_EPOLL_INTERNAL_THREAD | MHD_USE_ITC | MHD_USE_ERROR_LOG, 0, nullptr, nullptr,
      static_cast<MHD_AccessHandlerCallback>(&HttpAnswers::Answer), endpoint.get(), MHD_OPTION_EXTERNAL_LOGGER,
      &LogMessage, nullptr, MHD_OPTION_LISTEN_SOCKET, fd, MHD_OPTION_CONNECTION_LIMIT, MostConnections(),
      MHD_OPTION_CONNECTION_TIMEOUT, kSilentSeconds, MHD_OPTION_CONNECTION_MEMORY_LIMIT, kRequestBytes, MHD_OPTION_END);
  if (endpoint->daemon_ == nullptr) {
    close(fd);
    return absl::UnavailableError(absl::StrCat("cannot serve on ", listen));
  }
  const bool brackets = host.find(':') != std::string::npos;
  endpoint->address_ = absl::StrCat(host.empty() ? "0.0.0.0"
                                    : brackets   ? absl::StrCat("[", host, "]")
                                                 : host,
                                    ":", port);
  return endpoint;
}

HttpEndpoint::~HttpEndpoint() {
  if (daemon_ != nullptr) MHD_stop_daemon(daemon_);  // and closes the socket
}

}  // namespace voxelpipe
