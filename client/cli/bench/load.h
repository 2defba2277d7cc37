// A load on servers: its plan and its results. No gRPC in this header.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "bench/arrivals.h"
#include "bench/histogram.h"
#include "job/request.h"
#include "load/decode/mesh_format.h"
#include "load/file_bytes.h"

namespace voxelpipe::cli {

struct LoadPlan {
  std::vector<std::string> servers;  // at least one
  FileBytes mesh;
  MeshFileType mesh_type;
  VoxelizeRequest request;
  // Fields of the message besides the request; absent or empty: the server's choice.
  std::string priority;     // high, normal, low
  std::string compression;  // none, zstd
  std::optional<int64_t> queue_timeout_ms;
  std::optional<bool> fallback;

  bool without_hash = false;  // no SHA-256 of the results

  bool many = false;    // jobs of VoxelizeBatch streams instead of calls
  bool stream = false;  // use VoxelizeUpload even where Voxelize suffices
  // Send equal requests. Otherwise they differ without effect on the result, so that a server cannot share a run.
  bool same_request = false;
  bool send_mesh = false;      // send the bytes each time instead of the name of an uploaded mesh
  bool honour_retry = false;   // resend a refused request after the returned delay
  int connections = 0;         // 0: one per server
  int concurrency = 1;         // closed loop: clients that send their next request after the last response
  std::optional<double> rate;  // open loop: requests a second, all servers together
  Arrivals arrivals = Arrivals::kPoisson;
  uint64_t seed = 1;
  int max_in_flight = 4096;  // open loop: beyond this, scheduled requests wait, and their latency counts
  double warmup_seconds = 0;
  double seconds = 0;  // duration of sending
  std::optional<std::chrono::milliseconds> deadline;
  std::optional<int> server_pid;  // on this machine: its CPU time is measured, too
};

// The outcome of one request. Times in nanoseconds.
struct Outcome {
  absl::StatusCode code = absl::StatusCode::kOk;
  uint64_t latency_ns = 0;  // since the scheduled time
  uint64_t lag_ns = 0;      // from the scheduled time to sending
  // Of a response:
  uint64_t result_bytes = 0;
  uint64_t received_bytes = 0;  // messages, compressed pieces included
  uint64_t queue_ns = 0, mesh_ns = 0, voxelize_ns = 0;
  std::string worker;
  uint32_t batch_jobs = 0;
  std::optional<uint64_t> batch_launches;
  uint32_t attempts = 0;
  bool cached = false;
  uint32_t resends = 0;  // resent after the returned delay
  // Of a failure: true if the server returned a retry delay.
  bool retry_info = false;
};

// The failures with one code.
struct Failures {
  uint64_t count = 0;
  uint64_t with_retry_info = 0;
  Histogram latency_ns;
};

// Sums over outcomes. Not thread-safe: one per thread, merged at the end.
struct Tally {
  void Add(const Outcome& outcome);
  void Merge(const Tally& other);

  uint64_t requests = 0, ok = 0;
  std::map<std::string, Failures> errors;  // by the code's name
  // Of responses only:
  Histogram latency_ns, queue_ns, mesh_ns, voxelize_ns;
  uint64_t result_bytes = 0, received_bytes = 0;
  std::map<std::string, uint64_t> workers;  // jobs by the worker that ran them
  uint64_t batch_jobs = 0, batch_jobs_max = 0, batched_answers = 0;
  double launches = 0;  // each job counts its share of its batch
  uint64_t launch_answers = 0;
  uint64_t retried = 0, cached = 0;
  uint64_t resends = 0;
  // Of all:
  Histogram lag_ns;
};

struct LoadResult {
  Tally tally;
  double issue_seconds = 0, drain_seconds = 0;  // from the window's end to the last response
  double client_cpu_seconds = 0;
  std::optional<double> server_cpu_seconds;
  int connections = 0;
  bool mesh_sent = false;  // the bytes with each request
  std::string call;        // "mesh", "stream" or "many"
  std::string hash;        // of every response
  uint64_t bytes = 0;      // of one response
  bool interrupted = false;
};

// Uploads the mesh, sends one request to each server before the measurement, with which all responses are compared,
// then runs the load. Errors: those of the connections, the upload and the first requests; later errors are only
// counted. A signal (InterruptSignal) ends the run early and cancels running requests.
absl::StatusOr<LoadResult> RunLoad(const LoadPlan& plan);

}  // namespace voxelpipe::cli
