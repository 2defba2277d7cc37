// RunLoad of a build without the service.
#include "bench/load.h"
#include "engine/server_option.h"

namespace voxelpipe::cli {

absl::StatusOr<LoadResult> RunLoad(const LoadPlan& plan) {
  return CheckServerOption(plan.servers.front());
}

}  // namespace voxelpipe::cli
