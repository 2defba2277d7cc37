// The connection to a server, for code of this repository that uses gRPC directly.
#pragma once

#include <memory>
#include <string>

#include <grpcpp/channel.h>

#include "absl/status/statusor.h"
#include "client.h"

namespace voxelpipe {

// In: as for Client::Connect. Out: a connected channel with a connection of its own. Errors: those of Client::Connect.
absl::StatusOr<std::shared_ptr<grpc::Channel>> OpenChannel(const std::string& target, const ConnectOptions& options);

}  // namespace voxelpipe
