#include "engine/server_option.h"

namespace voxelpipe::cli {

#ifdef VOXELPIPE_HAVE_SERVICE

// The rest is in remote_engine.cpp.
absl::Status CheckServerOption(const std::string&) {
  return absl::OkStatus();
}

#else

absl::Status CheckServerOption(const std::string& server) {
  if (server.empty()) return absl::OkStatus();
  return absl::UnimplementedError("--server: this build was made without the service");
}

absl::StatusOr<MeshFacts> RemoteFacts(const std::string& server, const std::string&, const MeshReading&,
                                      const JobContext&) {
  return CheckServerOption(server);
}

absl::StatusOr<std::vector<std::string>> DescribeServer(const std::string& server, bool) {
  return CheckServerOption(server);
}

std::unique_ptr<Engine> MakeRemoteEngine(const std::string&, int) {
  return nullptr;
}

std::optional<std::chrono::milliseconds> RetryDelayOf(const absl::Status&) {
  return std::nullopt;
}

bool CouldNotConnect(const absl::Status&) {
  return false;
}

#endif

absl::StatusOr<std::unique_ptr<Engine>> MakeEngine(const std::string& server, int retries) {
  if (absl::Status status = CheckServerOption(server); !status.ok()) return status;
  return server.empty() ? MakeLocalEngine() : MakeRemoteEngine(server, retries);
}

}  // namespace voxelpipe::cli
