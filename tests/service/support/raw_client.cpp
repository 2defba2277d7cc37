#include "service/support/raw_client.h"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "absl/strings/str_cat.h"
#include "service/support/server_process.h"

namespace voxelpipe::testing {
namespace {

using Clock = std::chrono::steady_clock;

void PutBigEndian(std::string& bytes, uint32_t value, int count) {
  for (int i = count - 1; i >= 0; --i) bytes.push_back(char(uint8_t(value >> (8 * i))));
}

// HPACK's "literal header field without indexing, new name"; both shorter than 127 bytes.
void PutHeader(std::string& block, std::string_view name, std::string_view value) {
  block.push_back(0);
  block.push_back(char(name.size()));
  block.append(name);
  block.push_back(char(value.size()));
  block.append(value);
}

// False when the socket is not ready for `events` by then.
bool WaitUntil(int socket, short events, Clock::time_point deadline) {
  const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now()).count();
  pollfd wait{socket, events, 0};
  return left > 0 && poll(&wait, 1, int(left)) > 0;
}

}  // namespace

namespace http2 {

std::string Frame(uint8_t type, uint8_t flags, uint32_t stream, std::string_view payload) {
  std::string frame;
  PutBigEndian(frame, uint32_t(payload.size()), 3);
  frame.push_back(char(type));
  frame.push_back(char(flags));
  PutBigEndian(frame, stream, 4);
  frame.append(payload);
  return frame;
}

std::string Opening() {
  constexpr uint32_t kWindow = 0x7fff0000;
  std::string settings, update;
  PutBigEndian(settings, 4, 2);  // SETTINGS_INITIAL_WINDOW_SIZE
  PutBigEndian(settings, kWindow, 4);
  PutBigEndian(update, kWindow, 4);
  return "PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + Frame(kSettings, 0, 0, settings) + Frame(kWindowUpdate, 0, 0, update);
}

std::string Request(uint32_t stream, std::string_view path) {
  std::string block;
  PutHeader(block, ":method", "POST");
  PutHeader(block, ":scheme", "http");
  PutHeader(block, ":path", path);
  PutHeader(block, ":authority", "raw");
  PutHeader(block, "content-type", "application/grpc");
  PutHeader(block, "te", "trailers");
  return Frame(kHeaders, kEndHeaders, stream, block);
}

std::string Message(std::string_view serialized) {
  std::string message(1, '\0');
  PutBigEndian(message, uint32_t(serialized.size()), 4);
  return message.append(serialized);
}

std::string Data(uint32_t stream, std::string_view bytes, bool end) {
  std::string frames;
  do {
    const std::string_view part = bytes.substr(0, kFrameBytes);
    bytes.remove_prefix(part.size());
    frames += Frame(kData, end && bytes.empty() ? kEndStream : 0, stream, part);
  } while (!bytes.empty());
  return frames;
}

}  // namespace http2

absl::StatusOr<std::unique_ptr<RawClient>> RawClient::Connect(const std::string& address, int receive_buffer_bytes) {
  const size_t colon = address.rfind(':');
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(uint16_t(std::stoi(address.substr(colon + 1))));
  if (inet_pton(AF_INET, address.substr(0, colon).c_str(), &to.sin_addr) != 1) {
    return absl::InvalidArgumentError(absl::StrCat("not an address: ", address));
  }
  const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return absl::InternalError(absl::StrCat("socket: ", std::strerror(errno)));
  std::unique_ptr<RawClient> client(new RawClient(fd));
  if (receive_buffer_bytes > 0) {
    setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &receive_buffer_bytes, sizeof receive_buffer_bytes);
  }
  const int yes = 1;
  setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
  if (connect(fd, reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0) {
    return absl::UnavailableError(absl::StrCat("connect: ", std::strerror(errno)));
  }
  return client;
}

RawClient::~RawClient() {
  close(socket_);
}

bool RawClient::Send(std::string_view bytes) {
  const auto deadline = Clock::now() + kPatience;
  while (!bytes.empty()) {
    if (!WaitUntil(socket_, POLLOUT, deadline)) return false;
    const ssize_t n = send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (n < 0 && (errno == EAGAIN || errno == EINTR)) continue;
    if (n <= 0) return false;
    bytes.remove_prefix(size_t(n));
  }
  return true;
}

long RawClient::ReadSome(Clock::time_point deadline) {
  if (!WaitUntil(socket_, POLLIN, deadline)) return -1;
  char buffer[65536];
  const ssize_t n = recv(socket_, buffer, sizeof buffer, 0);
  if (n <= 0) return 0;
  received_.append(buffer, size_t(n));
  bytes_read_ += uint64_t(n);
  return long(n);
}

size_t RawClient::Read(size_t bytes, std::chrono::milliseconds patience) {
  const auto deadline = Clock::now() + patience;
  const uint64_t before = bytes_read_;
  while (bytes_read_ - before < bytes && ReadSome(deadline) > 0) received_.clear();
  return size_t(bytes_read_ - before);
}

std::optional<uint8_t> RawClient::NextFrame(std::string& payload, uint8_t& flags) {
  constexpr size_t kHeaderBytes = 9;
  if (received_.size() < kHeaderBytes) return std::nullopt;
  const auto byte = [&](size_t i) { return size_t(uint8_t(received_[i])); };
  const size_t length = byte(0) << 16 | byte(1) << 8 | byte(2);
  if (received_.size() < kHeaderBytes + length) return std::nullopt;
  const uint8_t type = uint8_t(byte(3));
  flags = uint8_t(byte(4));
  payload = received_.substr(kHeaderBytes, length);
  received_.erase(0, kHeaderBytes + length);
  return type;
}

bool RawClient::ReadUntilData() {
  const auto deadline = Clock::now() + kPatience;
  std::string payload;
  uint8_t flags = 0;
  while (true) {
    while (const std::optional<uint8_t> type = NextFrame(payload, flags)) {
      const bool answer = (flags & http2::kAck) == 0;
      if (*type == http2::kData) return true;
      if (*type == http2::kSettings && answer) Send(http2::Frame(http2::kSettings, http2::kAck, 0, ""));
      if (*type == http2::kPing && answer) Send(http2::Frame(http2::kPing, http2::kAck, 0, payload));
      if (*type == http2::kResetStream || *type == http2::kGoAway) return false;
      if (*type == http2::kHeaders && (flags & http2::kEndStream) != 0) return false;
    }
    if (ReadSome(deadline) <= 0) return false;
  }
}

bool RawClient::ReadUntilHangUp(std::chrono::milliseconds patience) {
  const auto deadline = Clock::now() + patience;
  while (true) {
    const long n = ReadSome(deadline);
    if (n <= 0) return n == 0;
    received_.clear();
  }
}

}  // namespace voxelpipe::testing
