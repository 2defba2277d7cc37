#include "web/web_endpoint.h"

#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdarg>
#include <cstdio>
#include <exception>
#include <string_view>
#include <utility>

#include <microhttpd.h>

#include "absl/strings/str_cat.h"
#include "observe/listen_socket.h"
#include "observe/log.h"
#include "web/exchange.h"
#include "web/http/client_socket.h"
#include "web/http/client_timeout.h"
#include "web/http/web_request.h"

namespace voxelpipe {
namespace {

constexpr std::chrono::seconds kHeadTime{10};  // for all headers of a request
constexpr std::chrono::milliseconds kWatchInterval{100};
// For the client to take the answer to a request whose body is not read.
constexpr std::chrono::seconds kRestTime{2};
// Of one connection: the headers of request and response, and a block of a body.
constexpr size_t kConnectionBytes = 160 << 10;

void LogHttp(void* /*self*/, const char* format, va_list arguments) {
  std::array<char, 300> text{};
  std::vsnprintf(text.data(), text.size(), format, arguments);
  const std::string line(text.data());
  LogMessage(LogLevel::kDebug, "web: " + line.substr(0, line.find('\n')));
}

}  // namespace

// The callbacks of the library.
struct WebCallbacks {
  static MHD_Result MayConnect(void* self, const sockaddr* address, socklen_t /*bytes*/) {
    return static_cast<WebEndpoint*>(self)->HasRoomFor(NetworkOf(address)) ? MHD_YES : MHD_NO;
  }

  static void Changed(void* self, MHD_Connection* connection, void** /*of_socket*/,
                      MHD_ConnectionNotificationCode what) {
    WebEndpoint& endpoint = *static_cast<WebEndpoint*>(self);
    const std::lock_guard lock(endpoint.mutex_);
    if (what == MHD_CONNECTION_NOTIFY_STARTED) {
      endpoint.connections_[connection] = {SocketOf(connection), NetworkOf(AddressOf(connection)),
                                           std::chrono::steady_clock::now()};
    } else {
      endpoint.connections_.erase(connection);
    }
  }

  static MHD_Result Answer(void* self, MHD_Connection* connection, const char* url, const char* method,
                           const char* /*version*/, const char* body, size_t* body_bytes, void** request) {
    try {
      return Answer(*static_cast<WebEndpoint*>(self), connection, url, method, body, body_bytes, request);
    } catch (const std::exception& error) {
      LogMessage(LogLevel::kError, absl::StrCat("web: ", error.what()));
      return MHD_NO;  // closes the connection
    }
  }

  static MHD_Result Answer(WebEndpoint& endpoint, MHD_Connection* connection, const char* url, const char* method,
                           const char* body, size_t* body_bytes, void** request) {
    if (*request == nullptr) {
      auto exchange = std::make_unique<Exchange>(endpoint.web_, url, method);
      {
        const std::lock_guard lock(endpoint.mutex_);
        if (const auto at = endpoint.connections_.find(connection); at != endpoint.connections_.end()) {
          at->second.has_head = true;
        }
        ++endpoint.requests_;
      }
      Exchange* const begun = exchange.release();
      *request = begun;  // Completed frees it
      return begun->Begin(connection);
    }
    auto& exchange = *static_cast<Exchange*>(*request);
    if (*body_bytes == 0) return exchange.End(connection);
    return exchange.Take({body, std::exchange(*body_bytes, 0)});
  }

  static void Completed(void* self, MHD_Connection* connection, void** request, MHD_RequestTerminationCode why) {
    if (*request == nullptr) return;
    WebEndpoint& endpoint = *static_cast<WebEndpoint*>(self);
    const auto* const exchange = static_cast<Exchange*>(std::exchange(*request, nullptr));
    const bool rest = exchange->leaves_body() && why == MHD_REQUEST_TERMINATED_COMPLETED_OK;
    delete exchange;
    {
      const std::lock_guard lock(endpoint.mutex_);
      --endpoint.requests_;
      endpoint.completed_.notify_all();
    }
    if (rest) DropRest(SocketOf(connection), kRestTime, kMaxMessageBytes);
  }
};

WebEndpoint::WebEndpoint(ServiceState& state, std::shared_ptr<grpc::Channel> channel, std::string address,
                         OriginRules origins)
    : web_(state, std::move(channel), std::move(origins)), address_(std::move(address)) {}

absl::StatusOr<std::unique_ptr<WebEndpoint>> WebEndpoint::Start(ServiceState& state,
                                                                std::shared_ptr<grpc::Channel> channel) {
  const ServerOptions& options = state.options;
  absl::StatusOr<std::vector<std::string>> origins = ParseOrigins(options.web_origin);
  if (!origins.ok()) return origins.status();
  const absl::StatusOr<ListenSocket> socket = ListenOn(options.web_listen);
  if (!socket.ok()) return socket.status();
  std::unique_ptr<WebEndpoint> endpoint(
      new WebEndpoint(state, std::move(channel), socket->address, OriginRules(socket->address, *std::move(origins))));
  endpoint->daemon_ = MHD_start_daemon(
      MHD_USE_THREAD_PER_CONNECTION | MHD_USE_INTERNAL_POLLING_THREAD | MHD_USE_POLL | MHD_USE_ITC | MHD_USE_ERROR_LOG,
      0, &WebCallbacks::MayConnect, endpoint.get(), static_cast<MHD_AccessHandlerCallback>(&WebCallbacks::Answer),
      endpoint.get(), MHD_OPTION_EXTERNAL_LOGGER, &LogHttp, nullptr, MHD_OPTION_LISTEN_SOCKET, socket->descriptor,
      MHD_OPTION_CONNECTION_LIMIT, kMaxWebConnections, MHD_OPTION_CONNECTION_TIMEOUT,
      SecondsOf(options.stall_timeout_ms), MHD_OPTION_CONNECTION_MEMORY_LIMIT, kConnectionBytes,
      MHD_OPTION_NOTIFY_COMPLETED, &WebCallbacks::Completed, endpoint.get(), MHD_OPTION_NOTIFY_CONNECTION,
      &WebCallbacks::Changed, endpoint.get(), MHD_OPTION_END);
  if (endpoint->daemon_ == nullptr) {
    close(socket->descriptor);
    return absl::UnavailableError(absl::StrCat("cannot serve on ", options.web_listen));
  }
  endpoint->watch_ = std::make_unique<Periodic>(kWatchInterval, [it = endpoint.get()] { it->CloseSlowHeads(); });
  return endpoint;
}

bool WebEndpoint::HasRoomFor(const ClientNetwork& client) {
  const uint32_t most = web_.state.options.web_connections_per_address;
  const std::lock_guard lock(mutex_);
  return most == 0 || std::count_if(connections_.begin(), connections_.end(),
                                    [&](const auto& entry) { return entry.second.client == client; }) < ptrdiff_t{most};
}

void WebEndpoint::CloseSlowHeads() {
  const auto now = std::chrono::steady_clock::now();
  const std::lock_guard lock(mutex_);
  for (const auto& [connection, at] : connections_) {
    // The connection's thread sees the end and closes the socket.
    if (!at.has_head && now - at.opened > kHeadTime) shutdown(at.socket, SHUT_RDWR);
  }
}

void WebEndpoint::Drain(std::chrono::steady_clock::time_point deadline) {
  listening_ = MHD_quiesce_daemon(daemon_);
  std::unique_lock lock(mutex_);
  completed_.wait_until(lock, deadline, [this] { return requests_ == 0; });
}

WebEndpoint::~WebEndpoint() {
  if (daemon_ != nullptr) MHD_stop_daemon(daemon_);
  if (listening_ >= 0) close(listening_);
}

}  // namespace voxelpipe
