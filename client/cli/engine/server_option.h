// The choice between this process and a server.
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "engine/engine.h"
#include "mesh/contents.h"
#include "mesh/health/health.h"
#include "mesh/report.h"

namespace voxelpipe::cli {

// The report on a mesh file, from a server or from this process.
struct MeshFacts {
  MeshReport report;
  MeshContents contents;
  WarningList warnings;                                // including those of all its textures
  std::vector<std::pair<std::string, double>> stages;  // load and flatten, milliseconds
  std::optional<MeshHealth> health{};                  // absent from a server
};

// UNIMPLEMENTED if a server is named and this build has no service.
absl::Status CheckServerOption(const std::string& server);

// The engine for a server, or the core in this process if `server` is empty. `retries`: how often a call is repeated
// that the server refused for a while. Errors: those of CheckServerOption.
absl::StatusOr<std::unique_ptr<Engine>> MakeEngine(const std::string& server, int retries = 2);

// The server's report on the mesh file at `path`.
absl::StatusOr<MeshFacts> RemoteFacts(const std::string& server, const std::string& path, const MeshReading& reading,
                                      const JobContext& job);

// The lines of `server-info`: a short table, or one JSON object.
absl::StatusOr<std::vector<std::string>> DescribeServer(const std::string& server, bool json);

// The retry delay that an overloaded server returned; empty if the error is not one of load.
std::optional<std::chrono::milliseconds> RetryDelayOf(const absl::Status& status);

// True if an error says that no connection to a server was made.
bool CouldNotConnect(const absl::Status& status);

// For server_option.cpp: an engine that calls a server. Connects at first use.
std::unique_ptr<Engine> MakeRemoteEngine(const std::string& server, int retries);

}  // namespace voxelpipe::cli
