#include "observe/http_status.h"

#include <fcntl.h>
#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <memory>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

using Clock = std::chrono::steady_clock;

class Socket {
 public:
  explicit Socket(int fd) : fd_(fd) {}
  ~Socket() {
    if (fd_ >= 0) close(fd_);
  }
  Socket(const Socket&) = delete;
  Socket& operator=(const Socket&) = delete;
  int fd() const { return fd_; }

 private:
  const int fd_;
};

// True if the socket becomes readable or writable (`events`) before the timeout.
bool WaitFor(int fd, short events, Clock::time_point end) {
  while (true) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(end - Clock::now()).count();
    pollfd waiting{fd, events, 0};
    const int ready = poll(&waiting, 1, left > 0 ? int(left) : 0);
    if (ready > 0) return true;
    if (ready == 0 || errno != EINTR) return false;
  }
}

// Sends the request and reads up to the status code; 0 with `error` if there is none.
int Talk(int fd, const std::string& request, Clock::time_point end, std::string& error) {
  size_t sent = 0;
  while (sent < request.size()) {
    if (!WaitFor(fd, POLLOUT, end)) break;
    const ssize_t n = send(fd, request.data() + sent, request.size() - sent, MSG_NOSIGNAL);
    if (n < 0 && errno != EAGAIN && errno != EINTR) break;
    sent += n > 0 ? size_t(n) : 0;
  }
  std::string answer;
  constexpr size_t kStatusBytes = sizeof("HTTP/1.1 200") - 1;
  std::array<char, 64> buffer{};
  while (sent == request.size() && answer.size() < kStatusBytes) {
    if (!WaitFor(fd, POLLIN, end)) break;
    const ssize_t n = recv(fd, buffer.data(), buffer.size(), 0);
    if (n == 0 || (n < 0 && errno != EAGAIN && errno != EINTR)) break;
    if (n > 0) answer.append(buffer.data(), size_t(n));
  }
  int status = 0;
  if (answer.size() >= kStatusBytes && answer.starts_with("HTTP/1.") &&
      absl::SimpleAtoi(answer.substr(9, 3), &status)) {
    return status;
  }
  error = "no answer";
  return 0;
}

}  // namespace

bool SplitHostPort(const std::string& address, std::string& host, int& port) {
  const size_t colon = address.rfind(':');
  host = colon == std::string::npos ? "" : address.substr(0, colon);
  const std::string digits = colon == std::string::npos ? address : address.substr(colon + 1);
  if (host.size() > 2 && host.front() == '[' && host.back() == ']') host = host.substr(1, host.size() - 2);
  return !digits.empty() && digits.find_first_not_of("0123456789") == std::string::npos &&
         absl::SimpleAtoi(digits, &port) && port <= 65535 && host.find_first_of(",+ []") == std::string::npos;
}

int HttpStatusOf(const std::string& address, const std::string& path, int timeout_ms, std::string& error) {
  const Clock::time_point end = Clock::now() + std::chrono::milliseconds(timeout_ms);
  std::string host;
  int port = 0;
  if (!SplitHostPort(address, host, port)) {
    error = "no HOST:PORT";
    return 0;
  }
  if (host.empty() || host == "0.0.0.0") host = "127.0.0.1";
  if (host == "::") host = "::1";
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  addrinfo* found = nullptr;
  if (const int wrong = getaddrinfo(host.c_str(), std::to_string(port).c_str(), &hints, &found); wrong != 0) {
    error = gai_strerror(wrong);
    return 0;
  }
  const std::unique_ptr<addrinfo, decltype(&freeaddrinfo)> addresses(found, &freeaddrinfo);
  const std::string request = absl::StrCat("GET ", path, " HTTP/1.1\r\nHost: ", host, "\r\nConnection: close\r\n\r\n");
  error = "no address";
  for (const addrinfo* to = addresses.get(); to != nullptr; to = to->ai_next) {
    const Socket socket_to(socket(to->ai_family, to->ai_socktype | SOCK_CLOEXEC | SOCK_NONBLOCK, to->ai_protocol));
    int wrong = 0;
    if (socket_to.fd() < 0) {
      wrong = errno;
    } else if (connect(socket_to.fd(), to->ai_addr, to->ai_addrlen) != 0 && (wrong = errno) == EINPROGRESS) {
      socklen_t size = sizeof wrong;
      if (!WaitFor(socket_to.fd(), POLLOUT, end)) {
        wrong = ETIMEDOUT;
      } else if (getsockopt(socket_to.fd(), SOL_SOCKET, SO_ERROR, &wrong, &size) != 0) {
        wrong = errno;
      }
    }
    if (wrong == 0) return Talk(socket_to.fd(), request, end, error);
    error = std::strerror(wrong);
  }
  return 0;
}

}  // namespace voxelpipe
