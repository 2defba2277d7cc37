// Listening sockets of the HTTP servers of this process.
#pragma once

#include <string>

#include "absl/status/statusor.h"

namespace voxelpipe {

struct ListenSocket {
  int descriptor = -1;  // not blocking; the caller closes it
  std::string address;  // HOST:PORT with the chosen port, an IPv6 host in brackets
};

// In: "HOST:PORT", or "PORT" for every IPv4 address; port 0 picks one. Errors: INVALID_ARGUMENT for an invalid address,
// UNAVAILABLE if it cannot be bound.
absl::StatusOr<ListenSocket> ListenOn(const std::string& listen);

}  // namespace voxelpipe
