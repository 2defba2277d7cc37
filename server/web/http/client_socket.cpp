#include "web/http/client_socket.h"

#include <poll.h>

namespace voxelpipe {

bool HasHungUp(int socket) {
  pollfd now{socket, POLLRDHUP, 0};
  return poll(&now, 1, 0) > 0 && (now.revents & (POLLRDHUP | POLLHUP | POLLERR | POLLNVAL)) != 0;
}

}  // namespace voxelpipe
