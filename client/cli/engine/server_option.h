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
#include "mesh/report.h"

namespace voxelpipe::cli {

// The report on a mesh file, from a server or made here.
struct MeshFacts {
  MeshReport report;
  MeshContents contents;
  WarningList warnings;                                // all of its textures included
  std::vector<std::pair<std::string, double>> stages;  // load and flatten, milliseconds
};

// UNIMPLEMENTED where a server is named and this build has no service.
absl::Status CheckServerOption(const std::string& server);

// Without a server (empty) the core in this process. Errors: those of CheckServerOption.
absl::StatusOr<std::unique_ptr<Engine>> MakeEngine(const std::string& server);

// What the server sees in the mesh file at `path`.
absl::StatusOr<MeshFacts> RemoteFacts(const std::string& server, const std::string& path, const OutsideFiles& outside,
                                      const JobContext& job);

// The text of `server-info`: a short table, or one JSON object.
absl::StatusOr<std::string> DescribeServer(const std::string& server, bool json);

// The retry delay that an overloaded server returned; empty if the error is not one of load.
std::optional<std::chrono::milliseconds> RetryDelayOf(const absl::Status& status);

// True if an error says that no connection to a server was made.
bool CouldNotConnect(const absl::Status& status);

// For server_option.cpp: the engine that calls a server. Connects when it is first used.
std::unique_ptr<Engine> MakeRemoteEngine(const std::string& server);

}  // namespace voxelpipe::cli
