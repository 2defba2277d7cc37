// The end of a service manager, to which a server reports by NOTIFY_SOCKET.
#pragma once

#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <cstddef>
#include <cstring>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

namespace voxelpipe::testing {

class NotifySocket {
 public:
  // In: "/PATH", where nothing is yet, or "@NAME".
  explicit NotifySocket(std::string name) : name_(std::move(name)), fd_(socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, name_.data(), name_.size());
    if (name_[0] == '@') address.sun_path[0] = 0;
    const size_t size = offsetof(sockaddr_un, sun_path) + name_.size() + size_t(name_[0] == '/');
    if (bind(fd_, reinterpret_cast<const sockaddr*>(&address), socklen_t(size)) != 0) {
      close(fd_);
      throw std::runtime_error("no socket for notifications at " + name_);
    }
  }
  ~NotifySocket() { close(fd_); }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;

  const std::string& name() const { return name_; }

  // The next message, if one arrives within this time.
  std::optional<std::string> Receive(std::chrono::milliseconds patience) {
    pollfd wait{fd_, POLLIN, 0};
    if (poll(&wait, 1, int(patience.count())) <= 0) return std::nullopt;
    char buffer[4096];
    const ssize_t size = recv(fd_, buffer, sizeof buffer, 0);
    if (size < 0) return std::nullopt;
    return std::string(buffer, size_t(size));
  }

 private:
  const std::string name_;
  const int fd_;
};

}  // namespace voxelpipe::testing
