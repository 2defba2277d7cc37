#include "service/support/web_client.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdlib>

#include "service/support/server_process.h"

namespace voxelpipe::testing {
namespace {

std::string Lower(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  return text;
}

// The contents of a chunked body. False if its end is missing.
bool Dechunk(std::string_view text, std::string& body) {
  for (;;) {
    const size_t line = text.find("\r\n");
    if (line == std::string_view::npos) return false;
    const size_t bytes = std::strtoull(std::string(text.substr(0, line)).c_str(), nullptr, 16);
    text.remove_prefix(line + 2);
    if (bytes == 0) return text.starts_with("\r\n");
    body += text.substr(0, bytes);
    if (text.size() < bytes + 2) return false;
    text.remove_prefix(bytes + 2);
  }
}

}  // namespace

std::string HttpReply::Header(const std::string& name) const {
  for (const auto& [key, value] : headers) {
    if (key == name) return value;
  }
  return "";
}

WebConnection::WebConnection(const std::string& address, int receive_buffer_bytes, const std::string& from)
    : socket_(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
  if (receive_buffer_bytes > 0) {
    setsockopt(socket_, SOL_SOCKET, SO_RCVBUF, &receive_buffer_bytes, sizeof receive_buffer_bytes);
  }
  sockaddr_in own{};
  own.sin_family = AF_INET;
  inet_pton(AF_INET, from.c_str(), &own.sin_addr);
  static_cast<void>(bind(socket_, reinterpret_cast<sockaddr*>(&own), sizeof own));
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(uint16_t(std::atoi(address.c_str() + address.rfind(':') + 1)));
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  static_cast<void>(!connect(socket_, reinterpret_cast<sockaddr*>(&to), sizeof to));  // Send tells
}

WebConnection::~WebConnection() {
  close(socket_);
}

bool WebConnection::Send(std::string_view bytes) const {
  while (!bytes.empty()) {
    const ssize_t sent = send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent <= 0) return false;
    bytes.remove_prefix(size_t(sent));
  }
  return true;
}

std::string WebConnection::Receive() const {
  pollfd waiting{socket_, POLLIN, 0};
  const auto patience = std::chrono::milliseconds(kPatience);
  if (poll(&waiting, 1, int(patience.count())) <= 0) return "";
  std::string buffer(64 << 10, '\0');
  const ssize_t got = recv(socket_, buffer.data(), buffer.size(), 0);
  buffer.resize(got > 0 ? size_t(got) : 0);
  return buffer;
}

HttpReply WebConnection::ReadReply() const {
  std::string text;
  for (std::string more = Receive(); !more.empty(); more = Receive()) text += more;
  HttpReply reply;
  const size_t end = text.find("\r\n\r\n");
  if (!text.starts_with("HTTP/1.1 ") || end == std::string::npos) return reply;
  reply.code = std::atoi(text.c_str() + 9);
  for (size_t at = text.find("\r\n") + 2; at < end + 2;) {
    const size_t colon = text.find(": ", at), line = text.find("\r\n", at);
    reply.headers.emplace_back(Lower(text.substr(at, colon - at)), text.substr(colon + 2, line - colon - 2));
    at = line + 2;
  }
  const std::string_view body = std::string_view(text).substr(end + 4);
  if (reply.Header("transfer-encoding") == "chunked") {
    reply.complete = Dechunk(body, reply.body);
  } else {
    reply.body = body;
    reply.complete = reply.Header("content-length").empty() ||
                     std::strtoull(reply.Header("content-length").c_str(), nullptr, 10) == body.size();
  }
  return reply;
}

std::string WebConnection::OwnAddress() const {
  sockaddr_in own{};
  socklen_t size = sizeof own;
  getsockname(socket_, reinterpret_cast<sockaddr*>(&own), &size);
  return "ipv4:127.0.0.1:" + std::to_string(ntohs(own.sin_port));
}

std::string HttpRequest(const std::string& address, const std::string& method, const std::string& path,
                        const HttpHeaders& headers, std::string_view body) {
  std::string host = address, lines;
  for (const auto& [name, value] : headers) {
    if (name == "Host") {
      host = value;
    } else {
      lines += name + ": " + value + "\r\n";
    }
  }
  if (!body.empty()) lines += "Content-Length: " + std::to_string(body.size()) + "\r\n";
  return method + " " + path + " HTTP/1.1\r\nHost: " + host + "\r\n" + lines + "\r\n" + std::string(body);
}

HttpReply Fetch(const std::string& address, const std::string& method, const std::string& path,
                const HttpHeaders& headers, std::string_view body) {
  const WebConnection connection(address);
  static_cast<void>(connection.Send(HttpRequest(address, method, path, headers, body)));  // refused bodies stay unread
  return connection.ReadReply();
}

std::string WebFrame(std::string_view message) {
  const auto n = uint32_t(message.size());
  std::string frame = {'\0', char(n >> 24), char(n >> 16), char(n >> 8), char(n)};
  return frame += message;
}

WebReplyOfCall ParseWebReply(HttpReply http) {
  WebReplyOfCall call;
  call.http = std::move(http);
  std::string_view left = call.http.body;
  while (left.size() >= 5) {
    const auto byte = [&](size_t i) { return size_t{uint8_t(left[i])}; };
    const size_t bytes = byte(1) << 24 | byte(2) << 16 | byte(3) << 8 | byte(4);
    const bool trailers = byte(0) == 0x80;
    if (left.size() < 5 + bytes) break;
    (trailers ? call.trailers : call.messages.emplace_back()) = left.substr(5, bytes);
    left.remove_prefix(5 + bytes);
  }
  constexpr std::string_view kStatus = "grpc-status: ";
  if (const size_t at = call.trailers.find(kStatus); at != std::string::npos && left.empty()) {
    call.status = std::atoi(call.trailers.c_str() + at + kStatus.size());
  }
  return call;
}

std::string WebMethod(const std::string& name) {
  return "/voxelpipe.v1.VoxelizationService/" + name;
}

WebReplyOfCall CallWeb(const std::string& address, const std::string& method, std::string_view message,
                       HttpHeaders headers) {
  headers.emplace_back("Content-Type", "application/grpc-web+proto");
  return ParseWebReply(Fetch(address, "POST", WebMethod(method), headers, WebFrame(message)));
}

}  // namespace voxelpipe::testing
