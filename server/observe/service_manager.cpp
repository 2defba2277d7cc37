#include "observe/service_manager.h"

#include <sys/socket.h>
#include <sys/time.h>
#include <sys/un.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

std::string Variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

}  // namespace

ServiceManager ServiceManager::OfEnvironment() {
  const std::string socket = Variable("NOTIFY_SOCKET"), pid = Variable("WATCHDOG_PID");
  int64_t microseconds = 0;
  int whose = 0;
  const bool watches = !socket.empty() && absl::SimpleAtoi(Variable("WATCHDOG_USEC"), &microseconds) &&
                       microseconds > 0 && (pid.empty() || (absl::SimpleAtoi(pid, &whose) && whose == getpid()));
  return ServiceManager(socket, std::chrono::microseconds(watches ? microseconds : 0));
}

std::chrono::milliseconds ServiceManager::alive_interval() const {
  return std::chrono::ceil<std::chrono::milliseconds>((watchdog_ + std::chrono::microseconds(1)) / 2);
}

absl::Status ServiceManager::Ready(const std::string& status) const {
  return Send(absl::StrCat("READY=1\nSTATUS=", status));
}

absl::Status ServiceManager::Stopping(std::chrono::milliseconds longest) const {
  const int64_t microseconds = std::chrono::microseconds(longest).count();
  return Send(absl::StrCat("STOPPING=1\nSTATUS=draining\nEXTEND_TIMEOUT_USEC=", microseconds));
}

absl::Status ServiceManager::Alive() const {
  return Send("WATCHDOG=1");
}

absl::Status ServiceManager::Send(const std::string& message) const {
  if (socket_.empty()) return absl::OkStatus();
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  // A path needs room for a 0 at its end, a name without a file none: its first byte is 0.
  const bool is_path = socket_[0] == '/';
  if ((!is_path && socket_[0] != '@') || socket_.size() > sizeof address.sun_path - size_t(is_path)) {
    return absl::InvalidArgumentError(absl::StrCat("NOTIFY_SOCKET: '", socket_, "' is no address of a unix socket"));
  }
  std::memcpy(address.sun_path, socket_.data(), socket_.size());
  if (!is_path) address.sun_path[0] = 0;
  const auto size = socklen_t(offsetof(sockaddr_un, sun_path) + socket_.size() + size_t(is_path));

  const int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (fd < 0) return absl::ErrnoToStatus(errno, "NOTIFY_SOCKET");
  const timeval patience{5, 0};
  setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
  ssize_t sent = -1;
  do {
    sent = sendto(fd, message.data(), message.size(), MSG_NOSIGNAL, reinterpret_cast<const sockaddr*>(&address), size);
  } while (sent < 0 && errno == EINTR);
  const int error = sent < 0 ? errno : 0;
  close(fd);
  return error == 0 ? absl::OkStatus() : absl::ErrnoToStatus(error, absl::StrCat("NOTIFY_SOCKET: '", socket_, "'"));
}

}  // namespace voxelpipe
