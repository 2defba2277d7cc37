#include <exception>
#include <map>
#include <new>
#include <nlohmann/json.hpp>

#include "absl/strings/str_cat.h"
#include "bench/bench_report.h"
#include "bench/load.h"
#include "commands/commands.h"
#include "engine/engine.h"
#include "engine/interrupt.h"
#include "engine/report.h"
#include "engine/server_option.h"
#include "options/mesh_flags.h"
#include "options/request_flags.h"
#include "options/standard_streams.h"
#include "shaders/catalog.h"

namespace voxelpipe::cli {
namespace {

struct BenchArguments {
  std::string mesh;
  RequestOptions request;
  LoadPlan plan;
  std::optional<int64_t> deadline_ms;
  std::string arrivals = "poisson", fallback;
  double max_error_rate = 0.01;
  bool json = false;
  MeshFlags mesh_flags;
};

absl::Status CheckOptions(const BenchArguments& arguments) {
  const LoadPlan& plan = arguments.plan;
  if (!(plan.seconds > 0)) return absl::InvalidArgumentError("--duration: more than 0 seconds");
  if (plan.warmup_seconds < 0) return absl::InvalidArgumentError("--warmup: at least 0 seconds");
  if (plan.concurrency < 1) return absl::InvalidArgumentError("--concurrency: at least 1");
  if (plan.connections < 0) return absl::InvalidArgumentError("--connections: at least 0");
  if (plan.max_in_flight < 1) return absl::InvalidArgumentError("--max-in-flight: at least 1");
  if (plan.rate && !(*plan.rate > 0)) return absl::InvalidArgumentError("--rate: more than 0 requests a second");
  if (arguments.deadline_ms && *arguments.deadline_ms < 1)
    return absl::InvalidArgumentError("--deadline-ms: at least 1");
  if (!(arguments.max_error_rate >= 0 && arguments.max_error_rate <= 1)) {
    return absl::InvalidArgumentError("--max-error-rate: 0 to 1");
  }
  if (arguments.deadline_ms && plan.many) {
    return absl::InvalidArgumentError("--deadline-ms is for single calls; use --queue-timeout-ms for jobs of a stream");
  }
  if (plan.connections > 0 && size_t(plan.connections) < plan.servers.size()) {
    return absl::InvalidArgumentError("--connections: at least one per server");
  }
  return absl::OkStatus();
}

absl::StatusOr<LoadResult> Run(BenchArguments& arguments) {
  try {
    JobContext reading;
    const CancelOnInterrupt cancel(reading);
    const MeshFlags& flags = arguments.mesh_flags;
    const absl::StatusOr<MeshFileType> type = MeshTypeOf(flags.input_format, flags.unit);
    if (!type.ok()) return type.status();
    absl::StatusOr<MeshInput> mesh =
        ReadMeshInput(arguments.mesh, {{flags.allow_outside, TexturesRead(arguments.plan.request)}, *type}, reading);
    if (!mesh.ok()) {
      return absl::Status(mesh.status().code(),
                          absl::StrCat(InputName(arguments.mesh), ": ", std::string(mesh.status().message())));
    }
    arguments.plan.mesh = std::move(mesh->bytes);
    arguments.plan.mesh_type = mesh->type;
    return RunLoad(arguments.plan);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory");
  } catch (const std::exception& error) {
    return absl::InternalError(error.what());
  }
}

int Bench(BenchArguments& arguments) {
  LoadPlan& plan = arguments.plan;
  const absl::StatusOr<VoxelizeRequest> request = BuildRequest(arguments.request);
  absl::Status status = request.status();
  if (status.ok()) status = CheckOptions(arguments);
  if (status.ok()) status = CheckServerOption(plan.servers.front());
  if (status.ok()) status = CheckInputStream({arguments.mesh});
  if (!status.ok()) {
    PrintError("", status);
    return 2;
  }
  plan.request = *request;
  plan.arrivals = arguments.arrivals == "fixed" ? Arrivals::kFixed : Arrivals::kPoisson;
  if (!arguments.fallback.empty()) plan.fallback = arguments.fallback == "yes";
  if (arguments.deadline_ms) plan.deadline = std::chrono::milliseconds(*arguments.deadline_ms);

  const absl::StatusOr<LoadResult> result = Run(arguments);
  if (!result.ok()) {
    PrintError("bench", result.status());
    return 1;
  }
  status = arguments.json ? PrintLine(JsonText(BenchJson(plan, *result))) : PrintLines(BenchTable(plan, *result));
  if (!status.ok()) PrintError("", status);
  if (const int signal = InterruptSignal(); signal != 0) return StoppedExitCode(signal);
  const uint64_t requests = result->tally.requests, errors = requests - result->tally.ok;
  if (double(errors) > arguments.max_error_rate * double(requests)) {
    PrintError("bench", absl::StrCat(errors, " of ", requests, " requests failed: more than --max-error-rate, ",
                                     arguments.max_error_rate));
    return 1;
  }
  return status.ok() && result->tally.ok > 0 ? 0 : 1;
}

void AddLoadOptions(Command& command, LoadPlan& plan, BenchArguments& arguments) {
  const std::string group = "Load";
  const auto add = [&](const char* name, ValueRef value, const char* type, const char* text) {
    return command.AddOption(name, value, Wrapped(text)).Group(group).Type(type);
  };
  const auto flag = [&](const char* name, bool& value, const char* text) {
    return command.AddFlag(name, value, Wrapped(text)).Group(group);
  };
  const Option concurrency =
      add("--concurrency", plan.concurrency, "C",
          "Closed loop (the default, with 1): C clients, each of which sends its next request after the last response");
  add("--rate", plan.rate, "R",
      "Open loop: R requests a second, independent of responses; latency counts from the scheduled send time (no "
      "coordinated omission)")
      .Excludes(concurrency);
  add("--arrivals", arguments.arrivals, "poisson|fixed",
      "Gaps of the open loop (default poisson: as from many callers)")
      .Choices({"poisson", "fixed"});
  add("--seed", plan.seed, "N", "Seed of the random gaps (default 1)");
  add("--duration", plan.seconds, "S", "Seconds in which requests are sent; then the run waits for all responses")
      .Required();
  add("--warmup", plan.warmup_seconds, "S", "Seconds of load before the measurement (default 0)");
  add("--deadline-ms", arguments.deadline_ms, "D", "Deadline of each call (default: none)");
  add("--connections", plan.connections, "K",
      "Connections, each with a thread (default: one per server). For results of megabytes use one per client");
  add("--max-in-flight", plan.max_in_flight, "N",
      "Most outstanding requests of an open loop (default 4096); beyond, scheduled ones wait, and their latency "
      "counts");
  flag("--honour-retry", plan.honour_retry,
       "Retry a refused request after the delay that the server returned (RetryInfo), as good clients do; its latency "
       "counts "
       "on");
  add("--max-error-rate", arguments.max_error_rate, "R",
      "Exit 1 if a larger share of the requests failed (default 0.01)");
  flag("--many", plan.many, "Send jobs on VoxelizeBatch streams, one per connection, instead of single calls");
  flag("--stream", plan.stream, "Use VoxelizeUpload, whose mesh comes in pieces, also for a small mesh");
  flag("--send-mesh", plan.send_mesh, "Send the mesh each time instead of uploading it once");
  flag("--same-request", plan.same_request,
       "Send equal requests, which may share a run on the server. Otherwise they differ without effect on the "
       "result");
  add("--server-pid", plan.server_pid, "PID", "Process of a server on this machine: its CPU time is measured too");
  add("--priority", plan.priority, "high|normal|low", "Of the requests").Choices({"high", "normal", "low"});
  add("--compression", plan.compression, "none|zstd", "Of the results").Choices({"none", "zstd"});
  flag("--without-hash", plan.without_hash, "No SHA-256 of results; each piece still has its CRC-32C");
  add("--queue-timeout-ms", plan.queue_timeout_ms, "T", "Maximum wait of a request for a worker");
  add("--fallback", arguments.fallback, "yes|no", "yes: another kind of worker may run the job").Choices({"yes", "no"});
}

}  // namespace

void AddBenchCommand(Command& app, int& exit_code) {
  auto arguments = std::make_shared<BenchArguments>();
  Command command = app.AddCommand("bench", "Put a load on servers and measure throughput and latency");
  command
      .AddOption("MESH", arguments->mesh,
                 "Mesh file: .glb, .gltf, .drc, .stl, .ply, .off, .obj, .3mf; - is standard input")
      .Required()
      .Type("");
  command.AddOption("--server", arguments->plan.servers, Wrapped("A server; several with commas or several --server"))
      .Required()
      .Type("HOST:PORT")
      .Delimiter(',')
      .Repeatable()
      .Check([](const std::string& server) { return server.empty() ? "--server: must not be empty" : ""; });
  command.AddFlag("--json", arguments->json, "Print one JSON object");
  AddMeshFlags(command, arguments->mesh_flags);
  AddLoadOptions(command, arguments->plan, *arguments);
  AddRequestFlags(command, arguments->request);
  command.SetCallback([arguments, &exit_code] { exit_code = Bench(*arguments); });
}

}  // namespace voxelpipe::cli
