#include "observe/metrics.h"

#include <algorithm>
#include <cassert>

#include <prometheus/family.h>
#include <prometheus/registry.h>
#include <prometheus/text_serializer.h>

#include "observe/process_metrics.h"

namespace voxelpipe {
namespace {

using prometheus::BuildCounter;
using prometheus::BuildGauge;
using prometheus::BuildHistogram;
using prometheus::Counter;
using prometheus::Family;
using prometheus::Gauge;
using prometheus::Histogram;
using prometheus::Registry;

constexpr std::array<const char*, kRpcs> kRpcNames = {
    "Voxelize",   "VoxelizeUpload", "VoxelizeBatch", "ExportFile",  "EstimateVoxelization",
    "CreateMesh", "UploadMesh",     "GetMesh",       "ListMeshes",  "ReleaseMesh",
    "DeleteMesh", "ListShaders",    "GetServerInfo", "HealthCheck", "HealthWatch"};
constexpr std::array<const char*, kRefusals> kRefusalNames = {
    "no_token", "bad_token", "role", "quota_rate", "quota_calls", "quota_bytes", "tls_handshake"};
constexpr std::array<const char*, kAdmissions> kAdmissionNames = {"jobs", "bytes", "time", "deadline"};
constexpr std::array<const char*, kPriorityClasses> kPriorityNames = {"high", "normal", "low"};
constexpr std::array<const char*, 17> kCodeNames = {
    "OK",        "CANCELLED",      "UNKNOWN",           "INVALID_ARGUMENT",   "DEADLINE_EXCEEDED",
    "NOT_FOUND", "ALREADY_EXISTS", "PERMISSION_DENIED", "RESOURCE_EXHAUSTED", "FAILED_PRECONDITION",
    "ABORTED",   "OUT_OF_RANGE",   "UNIMPLEMENTED",     "INTERNAL",           "UNAVAILABLE",
    "DATA_LOSS", "UNAUTHENTICATED"};
constexpr std::array<const char*, 13> kStageNames = {
    "load", "flatten", "vertex_shade", "plan", "coarse_raster", "tile_sort", "fine_raster",
    "emit", "sort",    "resolve",      "fill", "encode",        "other"};

const Histogram::BucketBoundaries kSecondsBuckets = {.0005, .001, .0025, .005, .01, .025, .05, .1, .25,
                                                     .5,    1,    2.5,   5,    10,  30,   60,  120};
const Histogram::BucketBoundaries kJobsBuckets = {1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024};

size_t CodeIndex(absl::StatusCode code) {
  const int index = int(code);
  return index >= 0 && index < int(kCodeNames.size()) ? size_t(index) : size_t(absl::StatusCode::kUnknown);
}

Counter& One(Registry& registry, const char* name, const char* help) {
  return BuildCounter().Name(name).Help(help).Register(registry).Add({});
}
Gauge& OneGauge(Registry& registry, const char* name, const char* help) {
  return BuildGauge().Name(name).Help(help).Register(registry).Add({});
}
Histogram& OneHistogram(Registry& registry, const char* name, const char* help,
                        const Histogram::BucketBoundaries& buckets) {
  return BuildHistogram().Name(name).Help(help).Register(registry).Add({}, buckets);
}
Gauge& Budget(Registry& registry, const char* name, const char* help, const char* budget) {
  return BuildGauge().Name(name).Help(help).Register(registry).Add({{"budget", budget}});
}

}  // namespace

const char* RpcName(Rpc rpc) {
  return kRpcNames[size_t(rpc)];
}

// Metrics whose labels are created on demand.
struct Metrics::Families {
  explicit Families(Registry& registry)
      : calls(BuildCounter()
                  .Name("voxelpipe_calls_total")
                  .Help("Calls that ended, by method and status code")
                  .Register(registry)),
        serving(BuildGauge()
                    .Name("voxelpipe_device_serving")
                    .Help("1 while the device takes jobs, 0 in quarantine")
                    .Register(registry)),
        workers(BuildGauge().Name("voxelpipe_device_workers").Help("Threads that feed the device").Register(registry)),
        workers_busy(BuildGauge()
                         .Name("voxelpipe_device_workers_busy")
                         .Help("Of these, those that run a batch")
                         .Register(registry)),
        batches(BuildCounter().Name("voxelpipe_device_batches_total").Help("Batches that ended").Register(registry)),
        jobs(BuildCounter().Name("voxelpipe_device_jobs_total").Help("Jobs in those batches").Register(registry)),
        launches(BuildCounter().Name("voxelpipe_device_launches_total").Help("Kernel launches").Register(registry)),
        failures(BuildCounter()
                     .Name("voxelpipe_device_failures_total")
                     .Help("Batches that failed because of the device")
                     .Register(registry)),
        quarantines(BuildCounter()
                        .Name("voxelpipe_device_quarantines_total")
                        .Help("Times the device was taken out of service")
                        .Register(registry)),
        probes_failed(BuildCounter()
                          .Name("voxelpipe_device_probes_failed_total")
                          .Help("Probes of a quarantined device that failed")
                          .Register(registry)),
        load_workers_ended(BuildCounter()
                               .Name("voxelpipe_load_workers_ended_total")
                               .Help("Processes that load meshes and died or were killed, by reason")
                               .Register(registry)),
        busy_seconds(BuildCounter()
                         .Name("voxelpipe_device_busy_seconds_total")
                         .Help("Time in which its workers ran batches, summed over workers")
                         .Register(registry)) {}

  Family<Counter>& calls;
  Family<Gauge>&serving, &workers, &workers_busy;
  Family<Counter>&batches, &jobs, &launches, &failures, &quarantines, &probes_failed, &load_workers_ended,
      &busy_seconds;
  const std::unique_ptr<prometheus::Collectable> process = MakeProcessMetrics();
};

Metrics::Metrics() : Metrics(std::make_unique<Registry>(), nullptr) {}

Metrics::Metrics(std::unique_ptr<Registry> registry, std::unique_ptr<Families>)
    : received_bytes(One(*registry, "voxelpipe_received_bytes_total", "Mesh bytes in requests")),
      sent_bytes(One(*registry, "voxelpipe_sent_bytes_total", "Result bytes in responses, after compression")),
      result_bytes(One(*registry, "voxelpipe_result_bytes_total", "The same result bytes before compression")),
      job_seconds(OneHistogram(*registry, "voxelpipe_job_seconds", "From the start of a run to the result in memory",
                               kSecondsBuckets)),
      batch_jobs(OneHistogram(*registry, "voxelpipe_batch_jobs", "Jobs in a batch", kJobsBuckets)),
      job_retries(One(*registry, "voxelpipe_job_retries_total", "Jobs run again after their device failed")),
      job_fallbacks(One(*registry, "voxelpipe_job_fallbacks_total",
                        "Jobs that ran on another kind of device than the one chosen")),
      queue_timeouts(One(*registry, "voxelpipe_queue_timeouts_total", "Jobs whose time-out passed while they waited")),
      jobs_shared(
          One(*registry, "voxelpipe_jobs_shared_total", "Jobs answered by an equal one that ran at the same time")),
      queue_bytes(OneGauge(*registry, "voxelpipe_queue_bytes", "Bytes that waiting jobs hold")),
      queue_seconds(OneGauge(*registry, "voxelpipe_queue_predicted_seconds", "Predicted work of the waiting jobs")),
      running_jobs(OneGauge(*registry, "voxelpipe_running_jobs", "Running jobs")),
      upload_bytes(Budget(*registry, "voxelpipe_memory_bytes", "Bytes in use, by budget", "uploads")),
      upload_limit_bytes(Budget(*registry, "voxelpipe_memory_limit_bytes", "Size of a budget", "uploads")),
      working_bytes(Budget(*registry, "voxelpipe_memory_bytes", "Bytes in use, by budget", "working")),
      working_limit_bytes(Budget(*registry, "voxelpipe_memory_limit_bytes", "Size of a budget", "working")),
      load_workers(OneGauge(*registry, "voxelpipe_load_workers", "Processes that load meshes")),
      load_workers_busy(OneGauge(*registry, "voxelpipe_load_workers_busy", "Of these, those that load one")),
      isolated_loads(One(*registry, "voxelpipe_isolated_loads_total", "Meshes and textures loaded by them")),
      mesh_store_bytes(OneGauge(*registry, "voxelpipe_mesh_store_bytes", "Memory of the stored meshes")),
      mesh_store_limit_bytes(OneGauge(*registry, "voxelpipe_mesh_store_limit_bytes", "Memory that they may take")),
      mesh_store_meshes(OneGauge(*registry, "voxelpipe_mesh_store_meshes", "Stored meshes")),
      mesh_store_hits(One(*registry, "voxelpipe_mesh_store_hits_total", "Names of meshes found in the store")),
      mesh_store_misses(One(*registry, "voxelpipe_mesh_store_misses_total", "Names of meshes not found in the store")),
      mesh_store_evictions(One(*registry, "voxelpipe_mesh_store_evictions_total", "Meshes evicted from the store")),
      result_cache_bytes(OneGauge(*registry, "voxelpipe_result_cache_bytes", "Memory of the cached results")),
      result_cache_limit_bytes(OneGauge(*registry, "voxelpipe_result_cache_limit_bytes", "Memory that they may take")),
      result_cache_hits(One(*registry, "voxelpipe_result_cache_hits_total", "Jobs answered from the result cache")),
      result_cache_misses(
          One(*registry, "voxelpipe_result_cache_misses_total", "Jobs whose result was not in the cache")),
      result_cache_evictions(
          One(*registry, "voxelpipe_result_cache_evictions_total", "Results evicted from the cache")),
      certificate_expiry(OneGauge(*registry, "voxelpipe_certificate_expiry_timestamp_seconds",
                                  "When the server's certificate expires, seconds since 1970; 0 without TLS")),
      reloads(One(*registry, "voxelpipe_reloads_total", "Successful reloads of certificates and tokens")),
      reload_failures(One(*registry, "voxelpipe_reload_failures_total", "Failed reloads: the last valid files stay")),
      registry_(std::move(registry)),
      families_(std::make_unique<Families>(*registry_)) {
  Registry& all = *registry_;
  BuildGauge()
      .Name("voxelpipe_build_info")
      .Help("1, with the version as a label")
      .Register(all)
      .Add({{"version", VOXELPIPE_VERSION}})
      .Set(1);
  auto& in_flight = BuildGauge().Name("voxelpipe_calls_in_flight").Help("Calls in progress, by method").Register(all);
  auto& seconds = BuildHistogram().Name("voxelpipe_call_seconds").Help("Time of calls, by method").Register(all);
  for (size_t i = 0; i < kRpcs; ++i) {
    in_flight_[i] = &in_flight.Add({{"method", kRpcNames[i]}});
    call_seconds_[i] = &seconds.Add({{"method", kRpcNames[i]}}, kSecondsBuckets);
    for (size_t code = 0; code < kCodeNames.size(); ++code) {
      calls_[i][code] = &families_->calls.Add({{"method", kRpcNames[i]}, {"code", kCodeNames[code]}});
    }
  }
  auto& jobs = BuildCounter().Name("voxelpipe_jobs_total").Help("Jobs that ended, by status code").Register(all);
  for (size_t code = 0; code < kCodeNames.size(); ++code) jobs_[code] = &jobs.Add({{"code", kCodeNames[code]}});
  auto& refused = BuildCounter()
                      .Name("voxelpipe_refused_total")
                      .Help("Callers refused before their request was read")
                      .Register(all);
  for (size_t i = 0; i < kRefusals; ++i) refused_[i] = &refused.Add({{"reason", kRefusalNames[i]}});
  auto& turned =
      BuildCounter().Name("voxelpipe_queue_refusals_total").Help("Jobs that the queue refused, by limit").Register(all);
  for (size_t i = 0; i < kAdmissions; ++i) turned_[i] = &turned.Add({{"reason", kAdmissionNames[i]}});
  auto& waits = BuildHistogram()
                    .Name("voxelpipe_queue_wait_seconds")
                    .Help("From admission to the start of the run")
                    .Register(all);
  auto& waiting = BuildGauge().Name("voxelpipe_queue_jobs").Help("Waiting jobs").Register(all);
  for (size_t i = 0; i < kPriorityClasses; ++i) {
    queue_wait_[i] = &waits.Add({{"priority", kPriorityNames[i]}}, kSecondsBuckets);
    queue_jobs_[i] = &waiting.Add({{"priority", kPriorityNames[i]}});
  }
  auto& stages = BuildHistogram().Name("voxelpipe_stage_seconds").Help("Time of each stage of a job").Register(all);
  for (const char* name : kStageNames) stages_[name] = &stages.Add({{"stage", name}}, kSecondsBuckets);
}

Metrics::~Metrics() {
  assert(samplers_.empty());
}

std::string Metrics::Text() {
  {
    const std::lock_guard lock(samplers_mutex_);
    for (const Sampler* sampler : samplers_) sampler->sample_();
  }
  std::vector<prometheus::MetricFamily> all = registry_->Collect();
  for (auto& family : families_->process->Collect()) all.push_back(std::move(family));
  return prometheus::TextSerializer().Serialize(all);
}

std::unique_ptr<Metrics::Sampler> Metrics::BeforeText(std::function<void()> sample) {
  auto sampler = std::make_unique<Sampler>(*this, std::move(sample));
  const std::lock_guard lock(samplers_mutex_);
  samplers_.push_back(sampler.get());
  return sampler;
}

void Metrics::Remove(const Sampler* sampler) {
  const std::lock_guard lock(samplers_mutex_);
  std::erase(samplers_, sampler);
}

void Metrics::CallBegan(Rpc rpc) {
  in_flight_[size_t(rpc)]->Increment();
}

void Metrics::CallEnded(Rpc rpc, absl::StatusCode code, double seconds) {
  in_flight_[size_t(rpc)]->Decrement();
  calls_[size_t(rpc)][CodeIndex(code)]->Increment();
  call_seconds_[size_t(rpc)]->Observe(seconds);
}

Counter& Metrics::Refused(Refusal reason) {
  return *refused_[size_t(reason)];
}

void Metrics::JobEnded(absl::StatusCode code) {
  jobs_[CodeIndex(code)]->Increment();
}

Histogram& Metrics::QueueWait(size_t priority) {
  return *queue_wait_[std::min(priority, kPriorityClasses - 1)];
}

Histogram& Metrics::Stage(std::string_view name) {
  const auto found = stages_.find(name);
  return found != stages_.end() ? *found->second : *stages_.find("other")->second;
}

Counter& Metrics::Turned(Admission why) {
  return *turned_[size_t(why)];
}

Gauge& Metrics::QueueJobs(size_t priority) {
  return *queue_jobs_[std::min(priority, kPriorityClasses - 1)];
}

Counter& Metrics::LoadWorkersEnded(const std::string& reason) {
  return families_->load_workers_ended.Add({{"reason", reason}});
}

DeviceMetrics& Metrics::Device(const std::string& name) {
  const std::lock_guard lock(devices_mutex_);
  std::unique_ptr<DeviceMetrics>& device = devices_[name];
  if (!device) {
    const prometheus::Labels label = {{"device", name}};
    Families& f = *families_;
    device.reset(new DeviceMetrics{f.serving.Add(label), f.workers.Add(label), f.workers_busy.Add(label),
                                   f.batches.Add(label), f.jobs.Add(label), f.launches.Add(label),
                                   f.failures.Add(label), f.quarantines.Add(label), f.probes_failed.Add(label),
                                   f.busy_seconds.Add(label)});
  }
  return *device;
}

}  // namespace voxelpipe
