// The choice between this process and a server.
#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "engine.h"

namespace voxelpipe::cli {

// Without a server (empty), the core in this process. UNIMPLEMENTED where this build has no service.
absl::StatusOr<std::unique_ptr<Engine>> MakeEngine(const std::string& server);

}  // namespace voxelpipe::cli
