#include "service_state.h"

#include <algorithm>

#include "pipeline/backend.h"

namespace voxelpipe {

JobLimits LimitsOf(const ServerOptions& resolved) {
  JobLimits limits;
  limits.load.max_file_bytes = resolved.max_file_bytes;
  limits.plan.max_result_bytes = resolved.max_result_bytes;
  limits.plan.max_working_bytes = resolved.max_working_bytes;
  limits.plan.slab_bytes = resolved.stream_above_mb << 20;
  return limits;
}

std::chrono::milliseconds IdleIntervalOf(const ServerOptions& resolved) {
  return std::chrono::milliseconds(
      std::clamp(std::min(resolved.stall_timeout_ms, resolved.upload_idle_timeout_ms) / 8, 1u, 1000u));
}

WorkerPoolOptions WorkersOf(const ServerOptions& resolved) {
  WorkerPoolOptions pool;
  pool.loaders = resolved.workers;
  pool.threads = resolved.threads;
  for (const Backend* device : Devices()) {
    if (resolved.backend == BackendChoice::kCpu && device->name() != "cpu") continue;
    pool.devices.push_back({device, resolved.workers});
  }
  return pool;
}

}  // namespace voxelpipe
