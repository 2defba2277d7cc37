// Addresses of servers.
#pragma once

#include <string>

#include "absl/status/status.h"

namespace voxelpipe {

// INVALID_ARGUMENT naming the address unless a server may have it: HOST:PORT, with an IPv6 address in brackets, or
// another name that gRPC takes (unix:/PATH, unix-abstract:, vsock:, ipv4:, ipv6:, xds:, dns: with a port). gRPC itself
// tries an address without a port at one that nothing listens at, and takes a URL for a host's name.
absl::Status CheckAddress(const std::string& address);

}  // namespace voxelpipe
