#include "server_option.h"

#ifdef VOXELPIPE_HAVE_SERVICE
#include "remote_engine.h"
#endif

namespace voxelpipe::cli {

absl::StatusOr<std::unique_ptr<Engine>> MakeEngine(const std::string& server) {
  if (server.empty()) return MakeLocalEngine();
#ifdef VOXELPIPE_HAVE_SERVICE
  return MakeRemoteEngine(server);
#else
  return absl::UnimplementedError("--server: this build was made without the service");
#endif
}

}  // namespace voxelpipe::cli
