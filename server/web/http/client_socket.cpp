#include "web/http/client_socket.h"

#include <poll.h>
#include <sys/socket.h>

#include <algorithm>

namespace voxelpipe {

bool HasHungUp(int socket) {
  pollfd now{socket, POLLRDHUP, 0};
  return poll(&now, 1, 0) > 0 && (now.revents & (POLLRDHUP | POLLHUP | POLLERR | POLLNVAL)) != 0;
}

void DropRest(int socket, std::chrono::milliseconds time, uint64_t bytes) {
  using Clock = std::chrono::steady_clock;
  constexpr uint64_t kBlockBytes = 1 << 20;
  if (shutdown(socket, SHUT_WR) != 0) return;
  const auto end = Clock::now() + time;
  while (bytes > 0) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - Clock::now());
    pollfd waiting{socket, POLLIN, 0};
    if (left.count() <= 0 || poll(&waiting, 1, int(left.count())) <= 0) return;
    // MSG_TRUNC: TCP drops the bytes without copying them.
    const ssize_t got = recv(socket, nullptr, std::min(bytes, kBlockBytes), MSG_DONTWAIT | MSG_TRUNC);
    if (got <= 0) return;
    bytes -= uint64_t(got);
  }
}

}  // namespace voxelpipe
