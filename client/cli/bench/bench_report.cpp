#include "bench/bench_report.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "engine/report.h"

namespace voxelpipe::cli {
namespace {

double Milliseconds(double nanoseconds) {
  return nanoseconds * 1e-6;
}

double PerSecond(double count, const LoadResult& result) {
  const double seconds = result.issue_seconds + result.drain_seconds;
  return seconds > 0 ? count / seconds : 0;
}

double PerRequest(double value, uint64_t requests) {
  return requests == 0 ? 0 : value / double(requests);
}

nlohmann::ordered_json TimesJson(const Histogram& times) {
  return {{"p50", Milliseconds(double(times.Percentile(0.5)))},
          {"p90", Milliseconds(double(times.Percentile(0.9)))},
          {"p99", Milliseconds(double(times.Percentile(0.99)))},
          {"max", Milliseconds(double(times.max()))},
          {"mean", Milliseconds(times.Mean())}};
}

std::string TimesText(const Histogram& times) {
  return absl::StrFormat("p50 %.3f, p90 %.3f, p99 %.3f, max %.3f, mean %.3f",
                         Milliseconds(double(times.Percentile(0.5))), Milliseconds(double(times.Percentile(0.9))),
                         Milliseconds(double(times.Percentile(0.99))), Milliseconds(double(times.max())),
                         Milliseconds(times.Mean()));
}

// The part of the mean latency outside the server's figures: the network, gRPC on both sides, hand-over between
// threads.
double OtherMilliseconds(const Tally& tally) {
  return Milliseconds(
      std::max(0.0, tally.latency_ns.Mean() - tally.queue_ns.Mean() - tally.mesh_ns.Mean() - tally.voxelize_ns.Mean()));
}

nlohmann::ordered_json ServerJson(const LoadResult& result) {
  const Tally& tally = result.tally;
  nlohmann::ordered_json json;
  json["queue_ms"] = TimesJson(tally.queue_ns);
  json["mesh_ms"] = TimesJson(tally.mesh_ns);
  json["voxelize_ms"] = TimesJson(tally.voxelize_ns);
  json["other_ms"] = OtherMilliseconds(tally);
  json["workers"] = nlohmann::ordered_json::object();
  for (const auto& [worker, jobs] : tally.workers) json["workers"][worker] = jobs;
  json["batch_jobs"] = {{"mean", PerRequest(double(tally.batch_jobs), tally.batched_answers)},
                        {"max", tally.batch_jobs_max}};
  json["launches_per_request"] = tally.launch_answers == 0
                                     ? nlohmann::ordered_json(nullptr)
                                     : nlohmann::ordered_json(PerRequest(tally.launches, tally.launch_answers));
  json["retried"] = tally.retried;
  json["cached"] = tally.cached;
  if (result.server_cpu_seconds) {
    json["cpu_seconds"] = *result.server_cpu_seconds;
    json["cpu_us_per_request"] = PerRequest(*result.server_cpu_seconds * 1e6, tally.requests);
  }
  return json;
}

}  // namespace

nlohmann::ordered_json BenchJson(const LoadPlan& plan, const LoadResult& result) {
  const Tally& tally = result.tally;
  nlohmann::ordered_json json;
  json["requests"] = tally.requests;
  json["ok"] = tally.ok;
  json["errors"] = nlohmann::ordered_json::object();
  for (const auto& [code, failures] : tally.errors) json["errors"][code] = failures.count;
  json["seconds"] = result.issue_seconds + result.drain_seconds;
  json["per_second"] = PerSecond(double(tally.ok), result);
  json["latency_ms"] = TimesJson(tally.latency_ns);
  json["error_latency_ms"] = nlohmann::ordered_json::object();
  json["errors_with_retry_info"] = nlohmann::ordered_json::object();
  for (const auto& [code, failures] : tally.errors) {
    json["error_latency_ms"][code] = TimesJson(failures.latency_ns);
    json["errors_with_retry_info"][code] = failures.with_retry_info;
  }
  if (plan.honour_retry) json["resends"] = tally.resends;
  json["bytes_per_second"] = PerSecond(double(tally.result_bytes), result);
  json["received_bytes_per_second"] = PerSecond(double(tally.received_bytes), result);
  json["issue_seconds"] = result.issue_seconds;
  json["drain_seconds"] = result.drain_seconds;
  json["loop"] = plan.rate ? "open" : "closed";
  if (plan.rate) {
    json["rate"] = *plan.rate;
    json["arrivals"] = plan.arrivals == Arrivals::kPoisson ? "poisson" : "fixed";
    json["start_lag_ms"] = TimesJson(tally.lag_ns);
  } else {
    json["concurrency"] = plan.concurrency;
  }
  json["servers"] = plan.servers;
  json["connections"] = result.connections;
  json["call"] = result.call;
  json["mesh"] = result.mesh_sent ? "bytes" : "id";
  json["mesh_bytes"] = plan.mesh.size();
  json["result_bytes"] = result.bytes;
  json["hash"] = result.hash;
  json["server"] = ServerJson(result);
  json["client"] = {{"cpu_seconds", result.client_cpu_seconds},
                    {"cpu_us_per_request", PerRequest(result.client_cpu_seconds * 1e6, tally.requests)}};
  if (result.interrupted) json["interrupted"] = true;
  return json;
}

Lines BenchTable(const LoadPlan& plan, const LoadResult& result) {
  const Tally& tally = result.tally;
  Lines table = {absl::StrCat(
      "load",
      plan.rate ? absl::StrFormat(" of %.6g requests a second, %s", *plan.rate,
                                  plan.arrivals == Arrivals::kPoisson ? "at random" : "at equal gaps")
                : absl::StrFormat(" of %d clients", plan.concurrency),
      result.connections == 1 ? ", 1 connection" : absl::StrCat(", ", result.connections, " connections"), ", ",
      result.call == "many" ? "jobs of a stream" : "single calls", result.mesh_sent ? ", mesh sent each time" : "")};
  const auto row = [&](const char* name, const std::string& text) { table.push_back(TableRow(name, text, 14)); };
  row("answers", absl::StrCat(WithCommas(tally.ok), " of ", WithCommas(tally.requests), " requests in ",
                              absl::StrFormat("%.2f s (%.2f s of it to drain)",
                                              result.issue_seconds + result.drain_seconds, result.drain_seconds)));
  for (const auto& [code, failures] : tally.errors) {
    row("errors", absl::StrCat(WithCommas(failures.count), " ", code));
    row("  after, ms", TimesText(failures.latency_ns));
  }
  if (plan.honour_retry) row("sent again", absl::StrCat(WithCommas(tally.resends), " times, after the server's delay"));
  row("throughput", absl::StrFormat("%.1f a second, %s/s of results", PerSecond(double(tally.ok), result),
                                    HumanBytes(uint64_t(PerSecond(double(tally.result_bytes), result)))));
  if (tally.ok > 0) {
    row("latency, ms", TimesText(tally.latency_ns));
    if (plan.rate) row("sent late, ms", TimesText(tally.lag_ns));
    row("queue, ms", TimesText(tally.queue_ns));
    row("voxelize, ms", TimesText(tally.voxelize_ns));
    row("rest, ms", absl::StrFormat("mesh %.3f, network, gRPC and hand-over %.3f (means)",
                                    Milliseconds(tally.mesh_ns.Mean()), OtherMilliseconds(tally)));
    std::string workers;
    for (const auto& [worker, jobs] : tally.workers) {
      absl::StrAppend(&workers, workers.empty() ? "" : ", ", worker, " ", WithCommas(jobs));
    }
    if (!workers.empty()) row("workers", workers);
    if (tally.batched_answers > 0) {
      row("jobs a batch",
          absl::StrFormat("%.2f on average, %d at most", PerRequest(double(tally.batch_jobs), tally.batched_answers),
                          tally.batch_jobs_max));
    }
    if (tally.launch_answers > 0) {
      row("launches", absl::StrFormat("%.2f a request", PerRequest(tally.launches, tally.launch_answers)));
    }
    if (tally.cached > 0) row("shared", absl::StrCat(WithCommas(tally.cached), " answers from an equal request"));
  }
  std::string cpu =
      absl::StrFormat("this client %.1f us a request", PerRequest(result.client_cpu_seconds * 1e6, tally.requests));
  if (result.server_cpu_seconds) {
    absl::StrAppend(&cpu,
                    absl::StrFormat(", server %.1f us", PerRequest(*result.server_cpu_seconds * 1e6, tally.requests)));
  }
  row("CPU", cpu);
  return table;
}

}  // namespace voxelpipe::cli
