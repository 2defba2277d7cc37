// The metrics of the server, by Prometheus' conventions: base units (seconds, bytes), names with the prefix voxelpipe_.
// server/OPERATIONS.md lists every metric.
#pragma once

#include <array>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

#include <prometheus/counter.h>
#include <prometheus/gauge.h>
#include <prometheus/histogram.h>

#include "absl/status/status.h"

namespace prometheus {
class Registry;
}

namespace voxelpipe {

// The calls of all services of the server.
enum class Rpc {
  kVoxelize,
  kVoxelizeUpload,
  kVoxelizeBatch,
  kExportFile,
  kEstimateVoxelization,
  kCreateMesh,
  kUploadMesh,
  kGetMesh,
  kListMeshes,
  kReleaseMesh,
  kDeleteMesh,
  kListShaders,
  kGetServerInfo,
  kHealthCheck,
  kHealthWatch,
};
inline constexpr size_t kRpcs = 15;
// "Voxelize", ... as the protos name them; of the health service "HealthCheck", "HealthWatch".
const char* RpcName(Rpc rpc);

// Why a caller was refused before its request was read.
enum class Refusal {
  kNoToken,       // missing, but required
  kBadToken,      // unknown
  kRole,          // its role may not make the call
  kQuotaRate,     // too many calls a second
  kQuotaCalls,    // too many calls at the same time
  kQuotaBytes,    // too many bytes a second
  kTlsHandshake,  // no TLS, or an untrusted or invalid certificate
};
inline constexpr size_t kRefusals = 7;

// Why the queue refused a job.
enum class Admission {
  kJobs,      // too many waiting jobs
  kBytes,     // of too many bytes
  kTime,      // of too much predicted work
  kDeadline,  // its deadline would pass in the queue
};
inline constexpr size_t kAdmissions = 4;

inline constexpr size_t kPriorityClasses = 3;  // 0 high, 1 normal, 2 low

// The metrics of one device.
struct DeviceMetrics {
  prometheus::Gauge& serving;          // 1, or 0 while it is quarantined
  prometheus::Gauge& workers;          // threads that feed it
  prometheus::Gauge& workers_busy;     // of these, those with a batch
  prometheus::Counter& batches;        // ended, with or without error
  prometheus::Counter& jobs;           // in those batches
  prometheus::Counter& launches;       // kernel launches (CUDA)
  prometheus::Counter& failures;       // batches that failed because of the device, not the request
  prometheus::Counter& quarantines;    // times it was taken out of service
  prometheus::Counter& probes_failed;  // while quarantined
  prometheus::Counter& busy_seconds;   // of its workers together
};

// Callers update the members directly; all are thread-safe, none allocates. Must outlive all callers.
class Metrics {
 public:
  // A histogram of one time; the same buckets for all of them, from half a millisecond to two minutes.
  using Seconds = prometheus::Histogram;

  Metrics();
  ~Metrics();
  Metrics(const Metrics&) = delete;
  Metrics& operator=(const Metrics&) = delete;

  // Everything in Prometheus' text format, version 0.0.4. Runs the samplers first.
  std::string Text();

  // `sample` is called before every Text, on its thread, to set gauges that no other code updates (queue lengths, bytes
  // in use). It must stay callable until the returned token is destroyed, and must not call this object.
  class Sampler;
  [[nodiscard]] std::unique_ptr<Sampler> BeforeText(std::function<void()> sample);

  // ---- calls
  void CallBegan(Rpc rpc);
  // Once for every CallBegan.
  void CallEnded(Rpc rpc, absl::StatusCode code, double seconds);
  prometheus::Counter& received_bytes;  // of meshes, in requests
  prometheus::Counter& sent_bytes;      // of results, in responses, after compression
  prometheus::Counter& result_bytes;    // of the same results, before compression
  prometheus::Counter& Refused(Refusal reason);

  // ---- jobs: one a Voxelize or VoxelizeUpload call, many in a VoxelizeBatch
  void JobEnded(absl::StatusCode code);
  Seconds& QueueWait(size_t priority);  // below kPriorityClasses; from admission to a worker
  Seconds& job_seconds;                 // from the worker to the result in memory, including loading
  // A stage of the pipeline by its name in VoxelizeStats, or "load", "flatten", "encode". Others go to "other".
  Seconds& Stage(std::string_view name);
  prometheus::Histogram& batch_jobs;           // jobs in a batch when a worker takes it
  prometheus::Counter& job_retries;            // jobs run again elsewhere after their device failed
  prometheus::Counter& job_fallbacks;          // of these and of new ones, those moved to another kind of device
  prometheus::Counter& queue_timeouts;         // jobs whose queue time-out or deadline passed while they waited
  prometheus::Counter& jobs_shared;            // jobs answered by an equal one that ran at the same time
  prometheus::Counter& Turned(Admission why);  // jobs that the queue refused

  // ---- the queue and the workers now
  prometheus::Gauge& QueueJobs(size_t priority);
  prometheus::Gauge& queue_bytes;    // of waiting jobs
  prometheus::Gauge& queue_seconds;  // predicted work of the waiting jobs
  prometheus::Gauge& running_jobs;
  // Those of a device; created at the first call for a name ("cpu", "cuda:0"), later the same object.
  DeviceMetrics& Device(const std::string& name);

  // ---- memory
  prometheus::Gauge& upload_bytes;  // budget of mesh files being received or waiting: used, and its limit
  prometheus::Gauge& upload_limit_bytes;
  prometheus::Gauge& working_bytes;  // budget of jobs and results: used, and its limit
  prometheus::Gauge& working_limit_bytes;

  // ---- processes that load meshes (server/isolate/)
  prometheus::Gauge& load_workers;
  prometheus::Gauge& load_workers_busy;
  prometheus::Counter& isolated_loads;  // ended requests to them
  prometheus::Counter& LoadWorkersEnded(const std::string& reason);

  // ---- the mesh store and the result cache
  prometheus::Gauge& mesh_store_bytes;
  prometheus::Gauge& mesh_store_limit_bytes;
  prometheus::Gauge& mesh_store_meshes;
  prometheus::Counter& mesh_store_hits;
  prometheus::Counter& mesh_store_misses;
  prometheus::Counter& mesh_store_evictions;
  prometheus::Gauge& result_cache_bytes;
  prometheus::Gauge& result_cache_limit_bytes;
  prometheus::Counter& result_cache_hits;
  prometheus::Counter& result_cache_misses;
  prometheus::Counter& result_cache_evictions;

  // ---- configuration
  prometheus::Gauge& certificate_expiry;  // of the server's current certificate, seconds since 1970
  prometheus::Counter& reloads;           // successful reloads of certificates and tokens
  prometheus::Counter& reload_failures;   // failed reloads: the last valid ones stay

 private:
  struct Families;
  Metrics(std::unique_ptr<prometheus::Registry> registry, std::unique_ptr<Families> families);
  void Remove(const Sampler* sampler);

  const std::unique_ptr<prometheus::Registry> registry_;
  const std::unique_ptr<Families> families_;
  std::array<prometheus::Gauge*, kRpcs> in_flight_{};
  std::array<Seconds*, kRpcs> call_seconds_{};
  std::array<std::array<prometheus::Counter*, 17>, kRpcs> calls_{};
  std::array<prometheus::Counter*, 17> jobs_{};
  std::array<prometheus::Counter*, kRefusals> refused_{};
  std::array<prometheus::Counter*, kAdmissions> turned_{};
  std::array<Seconds*, kPriorityClasses> queue_wait_{};
  std::array<prometheus::Gauge*, kPriorityClasses> queue_jobs_{};
  std::map<std::string, Seconds*, std::less<>> stages_;  // never changes after construction

  std::mutex devices_mutex_;
  std::map<std::string, std::unique_ptr<DeviceMetrics>> devices_;
  std::mutex samplers_mutex_;
  std::vector<const Sampler*> samplers_;
};

// During its lifetime its function is called before every Text.
class Metrics::Sampler {
 public:
  Sampler(Metrics& metrics, std::function<void()> sample) : metrics_(metrics), sample_(std::move(sample)) {}
  // Waits for a running Text.
  ~Sampler() { metrics_.Remove(this); }
  Sampler(const Sampler&) = delete;
  Sampler& operator=(const Sampler&) = delete;

 private:
  friend class Metrics;
  Metrics& metrics_;
  const std::function<void()> sample_;
};

}  // namespace voxelpipe
