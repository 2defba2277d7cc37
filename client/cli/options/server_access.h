// How this run of the tool shows itself to servers, and whom it believes.
#pragma once

#include <string>

#include "absl/status/statusor.h"

namespace CLI {
class App;
}

namespace voxelpipe {
struct ConnectOptions;
}

namespace voxelpipe::cli {

// Gives every command of `app` that has --server the flags --tls, --tls-ca, --tls-cert, --tls-key, --tls-server-name
// and --token-file, and those that take results home --compress. Once, after the commands were added.
void AddServerAccessFlags(CLI::App& app);

// What those flags and the variable VOXELPIPE_TOKEN say, once the command line was parsed. Errors: INVALID_ARGUMENT for
// a token file that cannot be read or is empty. Only in builds with the service.
absl::StatusOr<ConnectOptions> MakeConnectOptions();

}  // namespace voxelpipe::cli
