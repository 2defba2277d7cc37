#include <algorithm>

#include "bench/load.h"

namespace voxelpipe::cli {

void Tally::Add(const Outcome& outcome) {
  ++requests;
  lag_ns.Add(outcome.lag_ns);
  resends += outcome.resends;
  if (outcome.code != absl::StatusCode::kOk) {
    Failures& failures = errors[absl::StatusCodeToString(outcome.code)];
    ++failures.count;
    failures.with_retry_info += outcome.retry_info ? 1 : 0;
    failures.latency_ns.Add(outcome.latency_ns);
    return;
  }
  ++ok;
  latency_ns.Add(outcome.latency_ns);
  queue_ns.Add(outcome.queue_ns);
  mesh_ns.Add(outcome.mesh_ns);
  voxelize_ns.Add(outcome.voxelize_ns);
  result_bytes += outcome.result_bytes;
  received_bytes += outcome.received_bytes;
  if (!outcome.worker.empty()) ++workers[outcome.worker];
  if (outcome.batch_jobs > 0) {
    ++batched_answers;
    batch_jobs += outcome.batch_jobs;
    batch_jobs_max = std::max<uint64_t>(batch_jobs_max, outcome.batch_jobs);
  }
  if (outcome.batch_launches) {
    ++launch_answers;
    launches += double(*outcome.batch_launches) / double(std::max(1u, outcome.batch_jobs));
  }
  if (outcome.attempts > 1) ++retried;
  if (outcome.cached) ++cached;
}

void Tally::Merge(const Tally& other) {
  requests += other.requests;
  ok += other.ok;
  for (const auto& [code, failures] : other.errors) {
    Failures& ours = errors[code];
    ours.count += failures.count;
    ours.with_retry_info += failures.with_retry_info;
    ours.latency_ns.Merge(failures.latency_ns);
  }
  latency_ns.Merge(other.latency_ns);
  queue_ns.Merge(other.queue_ns);
  mesh_ns.Merge(other.mesh_ns);
  voxelize_ns.Merge(other.voxelize_ns);
  result_bytes += other.result_bytes;
  received_bytes += other.received_bytes;
  for (const auto& [worker, count] : other.workers) workers[worker] += count;
  batch_jobs += other.batch_jobs;
  batch_jobs_max = std::max(batch_jobs_max, other.batch_jobs_max);
  batched_answers += other.batched_answers;
  launches += other.launches;
  launch_answers += other.launch_answers;
  retried += other.retried;
  cached += other.cached;
  lag_ns.Merge(other.lag_ns);
  resends += other.resends;
}

}  // namespace voxelpipe::cli
