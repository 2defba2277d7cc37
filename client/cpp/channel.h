// The connection to a server, for those parts of this repository that speak gRPC themselves.
#pragma once

#include <memory>
#include <string>

#include <grpcpp/channel.h>

#include "absl/status/statusor.h"
#include "client.h"

namespace voxelpipe {

// In: as for Client::Connect. Out: a channel with a connection of its own that stands. Errors: those of
// Client::Connect.
absl::StatusOr<std::shared_ptr<grpc::Channel>> OpenChannel(const std::string& target, const ConnectOptions& options);

}  // namespace voxelpipe
