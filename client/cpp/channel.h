// The connection to a server, for code of this repository that uses gRPC directly.
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include <grpcpp/channel.h>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "client.h"

namespace voxelpipe {

// In: as for Client::Connect. Out: a connected channel with a connection of its own. Errors: those of Client::Connect.
absl::StatusOr<std::shared_ptr<grpc::Channel>> OpenChannel(const std::string& target, const ConnectOptions& options);

// True if gRPC's error text says that no connection was made for a call.
bool SaysNotConnected(std::string_view text);

// UNIMPLEMENTED: the server does not know a call of the contract that this client is made for.
absl::Status OtherContractError(const std::string& target);

// Marks an error for IsConnectError.
void MarkConnectError(absl::Status& status);

}  // namespace voxelpipe
