// Credentials of the tool for servers, and the certificates that it trusts.
#pragma once

#include <string>

#include "absl/status/statusor.h"

namespace voxelpipe {
class Command;
struct ConnectOptions;
}  // namespace voxelpipe

namespace voxelpipe::cli {

// Gives every command of `app` that has --server the flags --tls, --tls-ca, --tls-cert, --tls-key, --tls-server-name
// and --token-file, and --compress to those that receive results. Once, after the commands were added.
void AddServerAccessFlags(Command& app);

// The values of those flags and of the variable VOXELPIPE_TOKEN, after the command line was parsed. Errors:
// INVALID_ARGUMENT for a token file that cannot be read or is empty. Only in builds with the service.
absl::StatusOr<ConnectOptions> MakeConnectOptions();

}  // namespace voxelpipe::cli
