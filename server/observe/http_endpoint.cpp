#include "observe/http_endpoint.h"

#include <array>
#include <atomic>
#include <chrono>
#include <string_view>
#include <thread>
#include <utility>

#include <civetweb.h>
#include <spdlog/spdlog.h>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "observe/metrics.h"

namespace voxelpipe {
namespace {

// Of the end's calls.
constexpr std::chrono::milliseconds kBetweenCalls{5};
constexpr char kText[] = "text/plain; charset=utf-8";
constexpr char kPrometheusText[] = "text/plain; version=0.0.4; charset=utf-8";

void Send(mg_connection* connection, const char* status, const char* type, const std::string& body, bool with_body) {
  mg_printf(connection,
            "HTTP/1.1 %s\r\nContent-Type: %s\r\nContent-Length: %zu\r\nCache-Control: no-store\r\n"
            "Connection: close\r\n\r\n",
            status, type, body.size());
  if (with_body) mg_write(connection, body.data(), body.size());
}

int LogMessage(const mg_connection*, const char* message) {
  spdlog::debug("http: {}", message);
  return 1;  // it was logged
}

// "HOST" and "PORT" of an address; no host for a port alone. False if there is no port of digits.
bool Split(const std::string& address, std::string& host, int& port) {
  const size_t colon = address.rfind(':');
  host = colon == std::string::npos ? "" : address.substr(0, colon);
  const std::string digits = colon == std::string::npos ? address : address.substr(colon + 1);
  return !digits.empty() && digits.find_first_not_of("0123456789") == std::string::npos &&
         absl::SimpleAtoi(digits, &port) && port <= 65535 && host.find_first_of(",+ ") == std::string::npos;
}

// The same to call it at.
bool SplitForCall(const std::string& address, std::string& host, int& port) {
  if (!Split(address, host, port)) return false;
  if (host.size() > 2 && host.front() == '[') host = host.substr(1, host.size() - 2);
  if (host.empty() || host == "0.0.0.0") host = "127.0.0.1";
  return true;
}

}  // namespace

absl::StatusOr<std::unique_ptr<HttpEndpoint>> HttpEndpoint::Start(const std::string& listen, Metrics& metrics,
                                                                  std::function<bool()> ready) {
  std::string host;
  int port = 0;
  if (!Split(listen, host, port)) return absl::InvalidArgumentError(absl::StrCat("no HOST:PORT: ", listen));
  mg_init_library(0);  // counted; nothing of TLS or files is wanted
  std::unique_ptr<HttpEndpoint> endpoint(new HttpEndpoint(metrics, std::move(ready)));
  const std::array<const char*, 11> options = {
      "listening_ports",   listen.c_str(), "num_threads", "8", "connection_queue", "16", "request_timeout_ms", "2000",
      "enable_keep_alive", "no",           nullptr};
  mg_callbacks callbacks{};
  callbacks.log_message = &LogMessage;
  endpoint->context_ = mg_start(&callbacks, nullptr, const_cast<const char**>(options.data()));
  if (endpoint->context_ == nullptr) return absl::UnavailableError(absl::StrCat("cannot listen on ", listen));
  mg_set_request_handler(endpoint->context_, "/", &HttpEndpoint::Answer, endpoint.get());
  mg_server_port bound{};
  if (mg_get_server_ports(endpoint->context_, 1, &bound) == 1) port = bound.port;
  endpoint->address_ = absl::StrCat(host.empty() ? "0.0.0.0" : host, ":", port);
  return endpoint;
}

HttpEndpoint::~HttpEndpoint() {
  if (context_ != nullptr) {
    // mg_stop waits for a thread that looks up every two seconds, or when somebody connects.
    std::atomic<bool> stopped = false;
    std::thread caller([&] {
      std::string host;
      int port = 0;
      if (!SplitForCall(address_, host, port)) return;
      while (!stopped) {
        std::array<char, 200> error{};
        mg_connection* const connection = mg_connect_client(host.c_str(), port, 0, error.data(), error.size());
        if (connection != nullptr) mg_close_connection(connection);
        std::this_thread::sleep_for(kBetweenCalls);
      }
    });
    mg_stop(context_);
    stopped = true;
    caller.join();
  }
  mg_exit_library();
}

int HttpEndpoint::Answer(mg_connection* connection, void* self) {
  return static_cast<HttpEndpoint*>(self)->Answer(connection);
}

int HttpEndpoint::Answer(mg_connection* connection) {
  const mg_request_info* request = mg_get_request_info(connection);
  const std::string_view method = request->request_method, path = request->local_uri;
  const bool head = method == "HEAD";
  if (!head && method != "GET") {
    Send(connection, "405 Method Not Allowed", kText, "GET or HEAD\n", true);
    return 405;
  }
  if (path == "/livez") {
    Send(connection, "200 OK", kText, "ok\n", !head);
    return 200;
  }
  if (path == "/readyz") {
    const bool ready = ready_();
    Send(connection, ready ? "200 OK" : "503 Service Unavailable", kText, ready ? "ok\n" : "not serving\n", !head);
    return ready ? 200 : 503;
  }
  if (path == "/metrics") {
    Send(connection, "200 OK", kPrometheusText, metrics_.Text(), !head);
    return 200;
  }
  Send(connection, "404 Not Found", kText, "/metrics, /livez and /readyz\n", !head);
  return 404;
}

int HttpStatusOf(const std::string& address, const std::string& path, int timeout_ms, std::string& error) {
  std::string host;
  int port = 0;
  if (!SplitForCall(address, host, port)) {
    error = "no HOST:PORT";
    return 0;
  }
  mg_init_library(0);
  std::array<char, 200> what{};
  int status = 0;
  if (mg_connection* connection = mg_connect_client(host.c_str(), port, 0, what.data(), what.size())) {
    mg_printf(connection, "GET %s HTTP/1.1\r\nHost: %s\r\nConnection: close\r\n\r\n", path.c_str(), host.c_str());
    if (mg_get_response(connection, what.data(), what.size(), timeout_ms) >= 0) {
      status = mg_get_response_info(connection)->status_code;
    }
    mg_close_connection(connection);
  }
  if (status == 0) error = what.front() != '\0' ? what.data() : "no answer";
  mg_exit_library();
  return status;
}

}  // namespace voxelpipe
