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

WorkerPoolOptions WorkersOf(const ServerOptions& resolved, Metrics& metrics) {
  if (resolved.max_device_mesh_bytes > 0) SetDeviceMeshBytes(resolved.max_device_mesh_bytes);  // the process's devices
  WorkerPoolOptions pool;
  pool.metrics = &metrics;
  pool.loaders = resolved.workers;
  pool.threads = resolved.threads;
  for (const Backend* device : Devices()) {
    if (resolved.backend == BackendChoice::kCpu && device->name() != "cpu") continue;
    pool.devices.push_back({device, resolved.workers});
  }
  return pool;
}

SchedulerOptions SchedulingOf(const ServerOptions& resolved, Metrics& metrics) {
  SchedulerOptions scheduling;
  scheduling.max_queue = resolved.max_queue;
  scheduling.max_queue_bytes = resolved.max_queue_bytes;
  scheduling.max_queue_ms = double(resolved.max_queue_ms);
  scheduling.max_batch_jobs = resolved.max_batch_jobs;
  scheduling.max_batch_ms = double(resolved.max_batch_ms);
  scheduling.max_batch_bytes = resolved.max_batch_bytes;
  scheduling.batch_delay = std::chrono::microseconds(resolved.batch_delay_us);
  scheduling.queue_timeout = std::chrono::milliseconds(resolved.queue_timeout_ms);
  scheduling.aging = std::chrono::milliseconds(resolved.queue_aging_ms);
  scheduling.giant_ms = double(resolved.giant_job_ms);
  scheduling.medium_ms = std::min(scheduling.medium_ms, scheduling.giant_ms);
  scheduling.loaders = size_t(resolved.workers);
  scheduling.metrics = &metrics;
  return scheduling;
}

std::unique_ptr<Metrics::Sampler> SampleQueue(const Scheduler& scheduler, Metrics& metrics) {
  return metrics.BeforeText([&scheduler, &metrics] {
    const QueueState state = scheduler.state();
    for (size_t p = 0; p < kPriorities; ++p) metrics.QueueJobs(p).Set(double(state.jobs[p]));
    metrics.queue_bytes.Set(double(state.bytes));
    metrics.queue_seconds.Set(state.ms * 1e-3);
    metrics.running_jobs.Set(double(state.running));
  });
}

}  // namespace voxelpipe
