// The state that all calls of one server share.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <utility>

#include "access/access_control.h"
#include "access/forwarded_peer.h"
#include "isolate/load_workers.h"
#include "jobs/job.h"
#include "jobs/result_export.h"
#include "meshes/mesh_store.h"
#include "observe/metrics.h"
#include "options/options.h"
#include "results/result_sharing.h"
#include "results/single_flight.h"
#include "run/worker_pool.h"
#include "schedule/byte_budget.h"
#include "schedule/scheduler.h"
#include "state/call_gate.h"
#include "state/full_queue.h"
#include "state/idle_watch.h"

namespace voxelpipe {

// Largest request message. Meshes beyond it come in several pieces.
inline constexpr int kMaxMessageBytes = 64 << 20;
// The minimum bytes of an upload in each --upload-idle-timeout-ms, unless it ends: a slow trickle counts as idle.
inline constexpr uint64_t kMinUploadBytes = 64 << 10;

// Jobs predicted to take less are not compared with others: the comparison costs a tenth of them and rarely finds an
// equal one.
inline constexpr double kMinSharedMs = 0.1;

JobLimits LimitsOf(const ServerOptions& resolved, LoadWorkers* load_workers = nullptr);
// Null if --isolate-loading is off. UNAVAILABLE if it is on but not possible.
absl::StatusOr<std::unique_ptr<LoadWorkers>> StartLoadWorkers(const ServerOptions& resolved);
SchedulerOptions SchedulingOf(const ServerOptions& resolved, Metrics& metrics);
// Updates the gauges of the queue before they are read.
std::unique_ptr<Metrics::Sampler> SampleQueue(const Scheduler& scheduler, Metrics& metrics);
// The devices that the operator chose, best first, with their options.
WorkerPoolOptions WorkersOf(const ServerOptions& resolved, Metrics* metrics = nullptr);
// FAILED_PRECONDITION if a requested GPU or kind of device is missing.
absl::Status CheckDevices(const ServerOptions& resolved);
// The interval of checking for idle clients: an eighth of the smallest limit.
std::chrono::milliseconds IdleIntervalOf(const ServerOptions& resolved);

// Thread-safe. Must outlive every call.
struct ServiceState {
  // `resolved`: options without zeros that mean "choose" (Resolve). `load`: null if this process loads all meshes.
  explicit ServiceState(const ServerOptions& resolved, std::unique_ptr<LoadWorkers> load = nullptr)
      : options(resolved),
        load_workers(std::move(load)),
        uploads(resolved.max_upload_bytes),
        working(resolved.max_working_bytes),
        files(resolved.export_bytes),
        meshes(resolved.max_mesh_store_bytes),
        gate(resolved.max_calls),
        idle_watch(IdleIntervalOf(resolved)),
        limits(LimitsOf(resolved, load_workers.get())),
        results(scheduler, working, metrics,
                {resolved.share_equal_jobs, resolved.result_cache_bytes, resolved.piece_bytes, kMinSharedMs}),
        scheduler(SchedulingOf(resolved, metrics), size_t(resolved.workers)),
        full_queue(scheduler, metrics),
        queue_sampler(SampleQueue(scheduler, metrics)),
        loaders(resolved.loaders),
        pool(scheduler, WorkersOf(resolved, &metrics), limits.plan) {}

  const ServerOptions options;
  const std::unique_ptr<LoadWorkers> load_workers;
  Metrics metrics;
  std::unique_ptr<AccessControl> access;  // set before the first call
  const ForwardedPeers peers;
  ResultExports exports;         // that the port for browsers offers to its calls
  ByteBudget uploads;            // mesh files being received or waiting
  ByteBudget working;            // predicted peaks of running jobs, results being sent
  ByteBudget files;              // temporary files of results that are sent as files
  MeshStore meshes;              // uploaded and stored
  SingleFlight<KeptMesh> loads;  // uploads being loaded, by the mesh's id and format
  CallGate gate;                 // closed while the server drains
  IdleWatch idle_watch;
  const JobLimits limits;
  ResultSharing results;  // between the calls and the scheduler
  Scheduler scheduler;
  FullQueue full_queue;
  const std::unique_ptr<Metrics::Sampler> queue_sampler;
  std::atomic<int> loaders;  // meshes that are loaded at the same time, now
  WorkerPool pool;           // last, so that its jobs end before the budgets are destroyed

  // Sets the sizes of budgets, stores and the pool from these options.
  void Resize(const ServerOptions& resolved);
};

}  // namespace voxelpipe
