#include "web/http/client_network.h"

#include <netinet/in.h>

#include <algorithm>
#include <cstring>

namespace voxelpipe {
namespace {

constexpr size_t kMappedAt = 12;     // where an IPv4 address stands in ::ffff:a.b.c.d
constexpr size_t kNetworkBytes = 8;  // of an IPv6 address

}  // namespace

ClientNetwork NetworkOf(const sockaddr* address) {
  ClientNetwork network{};
  if (address == nullptr) return network;
  if (address->sa_family == AF_INET) {
    network[kMappedAt - 2] = network[kMappedAt - 1] = 0xff;
    const auto& at = *reinterpret_cast<const sockaddr_in*>(address);
    std::memcpy(&network[kMappedAt], &at.sin_addr, sizeof at.sin_addr);
  } else if (address->sa_family == AF_INET6) {
    const in6_addr& at = reinterpret_cast<const sockaddr_in6*>(address)->sin6_addr;
    std::copy_n(at.s6_addr, IN6_IS_ADDR_V4MAPPED(&at) ? network.size() : kNetworkBytes, network.begin());
  }
  return network;
}

}  // namespace voxelpipe
