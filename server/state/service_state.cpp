#include "state/service_state.h"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_split.h"
#include "base/machine.h"
#include "pipeline/stages/backend.h"

namespace voxelpipe {

JobLimits LimitsOf(const ServerOptions& resolved, LoadWorkers* load_workers) {
  JobLimits limits;
  limits.load_workers = load_workers;
  // Otherwise a file could wait for memory that never becomes free.
  limits.load.max_file_bytes = std::min(resolved.max_file_bytes, resolved.max_upload_bytes);
  limits.load.max_triangles = resolved.max_triangles;
  limits.load.max_vertices = resolved.max_vertices;
  limits.load.max_instances = resolved.max_instances;
  limits.load.max_nodes = resolved.max_nodes;
  limits.load.max_json_bytes = resolved.max_json_bytes;
  limits.load.max_image_pixels = resolved.max_image_pixels;
  limits.load.max_total_image_pixels = 4 * resolved.max_image_pixels;
  limits.plan.max_result_bytes = resolved.max_result_bytes;
  limits.plan.max_working_bytes = resolved.max_working_bytes;
  limits.plan.slab_bytes = resolved.stream_above_mb << 20;
  return limits;
}

namespace {

// Extra loaders for clients while all others are busy.
int SpareLoaders(int loaders) {
  constexpr int kMinLoaders = 4, kMaxLoaders = 64;
  return std::clamp(loaders, kMinLoaders, kMaxLoaders);
}

// As many as meshes are loaded at the same time.
int ProcessesThatLoad(const ServerOptions& resolved) {
  return resolved.loaders + SpareLoaders(resolved.loaders);
}

// All of them together keep a fraction of the memory for jobs.
uint64_t KeptByProcesses(const ServerOptions& resolved) {
  constexpr uint64_t kShare = 8;
  return resolved.max_working_bytes / kShare;
}

}  // namespace

absl::StatusOr<std::unique_ptr<LoadWorkers>> StartLoadWorkers(const ServerOptions& resolved) {
  if (resolved.isolate_loading != "on") return nullptr;
  LoadWorkersOptions options;
  options.workers = ProcessesThatLoad(resolved);
  options.threads = options.process.threads = resolved.threads > 0 ? resolved.threads : CpuCount();
  options.memory_bytes = resolved.max_working_bytes;
  options.kept_bytes = KeptByProcesses(resolved);
  options.unused = std::chrono::milliseconds(resolved.idle_memory_ms);
  return LoadWorkers::Start(options);
}

std::chrono::milliseconds IdleIntervalOf(const ServerOptions& resolved) {
  return std::chrono::milliseconds(
      std::clamp(std::min(resolved.stall_timeout_ms, resolved.upload_idle_timeout_ms) / 8, 1u, 1000u));
}

namespace {

// "0,2" -> "cuda:0", "cuda:2".
std::vector<std::string> ChosenGpus(const std::string& gpus) {
  std::vector<std::string> names;
  if (gpus == "all" || gpus == "none") return names;
  for (const auto number : absl::StrSplit(gpus, ',')) names.push_back(absl::StrCat("cuda:", number));
  return names;
}

}  // namespace

WorkerPoolOptions WorkersOf(const ServerOptions& resolved, Metrics* metrics) {
  if (resolved.max_device_mesh_bytes > 0)
    SetDeviceMeshBytes(resolved.max_device_mesh_bytes);  // of the devices of the process
  WorkerPoolOptions pool;
  pool.loaders = resolved.loaders;
  pool.spare_loaders = SpareLoaders(resolved.loaders);
  pool.threads = resolved.threads;
  pool.max_attempts = resolved.max_attempts;
  pool.health.probe_interval = std::chrono::milliseconds(resolved.probe_interval_ms);
  pool.health.max_probe_interval =
      std::chrono::milliseconds(std::max(resolved.probe_interval_ms, resolved.max_probe_interval_ms));
  pool.stall = std::chrono::milliseconds(resolved.device_stall_ms);
  pool.metrics = metrics;
  // Without GPUs none is looked for, as that starts it.
  if (resolved.backend == BackendChoice::kCpu || resolved.gpus == "none") {
    if (resolved.backend != BackendChoice::kCuda || resolved.fallback) {
      pool.devices.push_back({*SelectBackend(BackendChoice::kCpu), resolved.cpu_workers});
    }
    return pool;
  }
  if (const auto gpu = SelectBackend(BackendChoice::kCuda); !gpu.ok()) {
    pool.why_no_gpu = std::string(gpu.status().message());
  }
  const std::vector<std::string> chosen = ChosenGpus(resolved.gpus);
  for (const Backend* device : Devices()) {
    if (device->name() == "cpu") {
      // With GPUs present it assists and replaces them.
      if (resolved.backend == BackendChoice::kCuda && !resolved.fallback) continue;
      pool.devices.push_back({device, resolved.cpu_workers});
      continue;
    }
    if (!chosen.empty() && std::find(chosen.begin(), chosen.end(), device->device()) == chosen.end()) continue;
    pool.devices.push_back({device, resolved.gpu_streams});
  }
  return pool;
}

void ServiceState::Resize(const ServerOptions& resolved) {
  uploads.set_limit(resolved.max_upload_bytes);
  working.set_limit(resolved.max_working_bytes);
  meshes.set_max_bytes(resolved.max_mesh_store_bytes);
  loaders = resolved.loaders;
  pool.Resize(resolved.loaders, resolved.cpu_workers);
  if (load_workers != nullptr) load_workers->SetWorkers(ProcessesThatLoad(resolved), KeptByProcesses(resolved));
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
  scheduling.loaders = size_t(resolved.loaders);
  scheduling.max_ready_bytes = resolved.max_queue_bytes;
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

absl::Status CheckDevices(const ServerOptions& resolved) {
  if (resolved.backend == BackendChoice::kCuda && resolved.gpus != "none") {
    if (const auto backend = SelectBackend(resolved.backend); !backend.ok()) return backend.status();
  }
  const std::vector<DeviceWorkers> devices = WorkersOf(resolved).devices;
  const auto is_there = [&](const auto& what) {
    return std::any_of(devices.begin(), devices.end(),
                       [&](const DeviceWorkers& device) { return what(*device.backend); });
  };
  if (resolved.backend == BackendChoice::kCpu) return absl::OkStatus();
  for (const std::string& name : ChosenGpus(resolved.gpus)) {
    if (!is_there([&](const Backend& device) { return device.device() == name; })) {
      return absl::FailedPreconditionError(absl::StrCat("--gpus: there is no ", name));
    }
  }
  if (resolved.backend == BackendChoice::kCuda &&
      !is_there([](const Backend& device) { return device.name() == "cuda"; })) {
    return absl::FailedPreconditionError("--backend cuda: --gpus leaves no GPU");
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe
