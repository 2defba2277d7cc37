// Which connections count as those of one client.
#pragma once

#include <array>
#include <cstdint>

#include <sys/socket.h>

namespace voxelpipe {

// An IPv4 address (as IPv6 writes it, ::ffff:a.b.c.d), or the first 64 bits of an IPv6 address: a host may take any
// number of addresses of such a network.
using ClientNetwork = std::array<uint8_t, 16>;

// In: an address of IPv4 or IPv6. All others, and null, count as one.
ClientNetwork NetworkOf(const sockaddr* address);

}  // namespace voxelpipe
