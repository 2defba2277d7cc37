#include "options/options.h"

#include <algorithm>
#include <cstdio>
#include <map>

#include "base/machine.h"
#include "base/text.h"
#include "command_line/command.h"
#include "command_line/usage_error.h"
#include "observe/unix_socket.h"
#include "options/option_list.h"

namespace voxelpipe {
namespace {

// Typical memory for loading one mesh.
constexpr uint64_t kLoaderBytes = 64 << 20;
// Two of the largest messages (service_state.h).
constexpr uint64_t kMinTransportBytes = 128 << 20;
constexpr uint32_t kDayMs = 86'400'000;
// Load balancers check health every few seconds.
constexpr uint32_t kLameDuckBeyondLoopbackMs = 5'000;
constexpr uint64_t kResultCacheOfPage = 64 << 20;

const std::map<std::string, BackendChoice> kBackends = {
    {"auto", BackendChoice::kAuto}, {"cpu", BackendChoice::kCpu}, {"cuda", BackendChoice::kCuda}};

const std::map<std::string, SimdChoice> kSimds = {{"auto", SimdChoice::kAuto},
                                                  {"scalar", SimdChoice::kScalar},
                                                  {"avx2", SimdChoice::kAvx2},
                                                  {"avx512", SimdChoice::kAvx512}};

// The address for a probe of the local server: the listening address, with the wildcard replaced by loopback.
std::string ProbeAddress(const ServerOptions& options) {
  // HTTP needs no certificate and no token.
  if (!options.http_listen.empty()) return "http://" + options.http_listen;
  const std::string& listen = options.listen;
  if (listen.starts_with("0.0.0.0:")) return "127.0.0.1" + listen.substr(7);
  if (listen.starts_with("[::]:")) return "[::1]" + listen.substr(4);
  return listen;
}

// The error in a value of --gpus; empty if valid.
std::string CheckGpus(const std::string& text) {
  if (text == "all" || text == "none") return "";
  for (size_t at = 0, comma; at <= text.size(); at = comma + 1) {
    comma = std::min(text.find(',', at), text.size());
    const bool digits = comma > at && text.find_first_not_of("0123456789", at) >= comma;
    if (!digits) return "not all, none or numbers with commas between them: " + text;
  }
  return "";
}

// The error in HOST:PORT; empty if valid. gRPC takes port 99999 for 34463, and ::1 for port 1 of the host ":".
std::string CheckHostPort(const std::string& text) {
  const size_t colon = text.rfind(':');
  const std::string port = colon == std::string::npos ? "" : text.substr(colon + 1);
  const bool digits = !port.empty() && port.size() <= 5 && port.find_first_not_of("0123456789") == std::string::npos;
  if (!digits || colon == 0 || std::stoul(port) > 65'535) return "not HOST:PORT with a port of 0 to 65535: " + text;
  const std::string host = text.substr(0, colon);
  if (host.find(':') != std::string::npos && !(host.starts_with('[') && host.ends_with(']'))) {
    return "an IPv6 address stands in brackets, [::1]:PORT: " + text;
  }
  return "";
}

// Of gRPC's address.
std::string CheckListen(const std::string& text) {
  if (!text.starts_with(kUnixScheme)) return CheckHostPort(text);
  const std::string path = UnixPathOf(text);
  if (path.empty()) return "unix: without the path of a socket";
  if (path.size() <= kMaxUnixPathBytes) return "";
  return "the path of a unix socket has at most " + std::to_string(kMaxUnixPathBytes) + " bytes, and this one " +
         std::to_string(path.size()) + ": " + path;
}

// Of the HTTP port's.
std::string CheckHttpListen(const std::string& text) {
  return text.empty() ? "" : CheckHostPort(text);
}

// Options that are valid each by itself, but not together. Out: the error, if there is one.
std::optional<ParseStop> CheckTogether(const ServerOptions& options, const std::vector<OptionValue>& values) {
  for (const OptionValue& value : values) {
    if (value.key != "max-file-bytes" || value.source == "default") continue;
    if (options.max_upload_bytes == 0 || options.max_file_bytes <= options.max_upload_bytes) continue;
    const std::string source = value.source == "flag" ? "" : value.source + ": ";
    return ParseStop{ParseStop::Kind::kCheck, source + "--" + value.key + ": " + value.value +
                                                  " is more than --max-upload-bytes, " +
                                                  std::to_string(options.max_upload_bytes)};
  }
  return std::nullopt;
}

// The defaults that depend on other options.
void ChooseDefaults(ServerOptions& options, std::vector<OptionValue>& values) {
  for (OptionValue& value : values) {
    if (value.source != "default") continue;
    if (value.key == "lame-duck-ms") {
      if (ListensBeyondLoopback(options.listen)) options.lame_duck_ms = kLameDuckBeyondLoopbackMs;
      value.value = std::to_string(options.lame_duck_ms);
    } else if (value.key == "result-cache-bytes") {
      if (!options.web_listen.empty()) options.result_cache_bytes = kResultCacheOfPage;
      value.value = std::to_string(options.result_cache_bytes);
    }
  }
}

// The options with their texts for --help and the tables of OPERATIONS.md, group by group.

void AddServing(OptionList& list, ServerOptions& o) {
  list.Group("Addresses");
  list.Add("--listen", o.listen, "HOST:PORT",
           "address of the gRPC service; port 0 picks one, which the line \"listening on HOST:PORT\" reports; "
           "unix:/PATH for a socket, of at most 107 bytes, at which no other server answers")
      .Check(CheckListen);
  list.Add("--http-listen", o.http_listen, "HOST:PORT",
           "address of /metrics, /livez and /readyz over HTTP; port 0 picks one, which the line \"http on HOST:PORT\" "
           "reports")
      .Check(CheckHttpListen);
  list.Add(
          "--web-listen", o.web_listen, "HOST:PORT",
          "address of the page for browsers, of gRPC-Web and of result files, over HTTP without TLS; port 0 picks one, "
          "which the line \"web on http://HOST:PORT\" reports; none: no page")
      .Check(CheckHttpListen);
  list.Add("--web-origin", o.web_origin, "ORIGIN,...",
           "further origins whose pages may use that address, such as https://voxels.example.org of a proxy before it");
  list.AddNumber(
      "--web-connections-per-address", o.web_connections_per_address, 0, kMaxWebConnections, "",
      "connections to that address at the same time from one IPv4 address or one IPv6 network of 64 bits, of "
      "128 in all; 0: no limit, for a proxy before it, from which all its clients come");
  list.AddBytes("--export-bytes", o.export_bytes, 1, "temporary files of results that are sent as files, together");
  list.Add("--reflection", o.reflection,
           "clients may query the descriptions of the services (grpc.reflection.v1 and v1alpha)");
}

void AddWork(OptionList& list, ServerOptions& o, std::string& backend, std::string& simd) {
  list.Group("Work");
  list.AddChoice("--backend", backend, {"auto", "cpu", "cuda"},
                 "backend of requests that name none; auto: CUDA if there is a device, otherwise the CPU");
  list.AddChoice("--simd", simd, {"auto", "avx512", "avx2", "scalar"},
                 "instruction set of the CPU backend for requests that name none");
  list.AddNumber(
      "--threads", o.threads, 0, 1024, "threads",
      "threads of the CPU backend, shared by the jobs of a batch; 0: one a CPU. Short jobs take no more than "
      "their share of the CPUs while other workers are busy");
  list.AddNumber(
      "--io-threads", o.io_threads, 0, 16, "threads",
      "threads that serve connections, of gRPC's own (one for every two cores, 2 to 16). More of them decrypt "
      "and checksum more bytes a second, and refuse sooner under overload; fewer cost less CPU a call. 0: "
      "one for every four CPUs");
  list.AddNumber("--loaders", o.loaders, 0, 1024, "meshes",
                 "meshes that are loaded (decoded, flattened) at the same time, for calls and uploads, on servers with "
                 "GPUs too; 0: one a CPU, fewer where --max-working-bytes has less than 64 MiB for each");
  list.AddNumber("--workers", o.workers, 0, 1024, "batches",
                 "batches that run on the CPU at the same time, on servers with GPUs too; 0: one a CPU, at most 4");
  list.AddNumber("--cpu-workers", o.cpu_workers, 0, 1024, "batches",
                 "the same, and takes precedence over --workers; 0: as --workers");
  list.Add("--gpus", o.gpus, "", "GPUs to use: all, none, or their numbers separated by commas (0,2)")
      .Check(CheckGpus, "all|none|N,N...");
  list.AddNumber("--gpu-streams", o.gpu_streams, 1, 64, "batches",
                 "batches that run on one GPU at the same time, each on a CUDA stream of its own");
  list.Add("--fallback", o.fallback,
           "another kind of worker may run a job that the chosen kind cannot run now; a request may forbid it");
  list.AddNumber("--max-attempts", o.max_attempts, 1u, 100u, "attempts",
                 "how often a job is run in all if its devices fail");
  list.AddNumber("--probe-interval-ms", o.probe_interval_ms, 1u, kDayMs, "ms",
                 "from a device's quarantine to its first probe; doubled after each probe that fails");
  list.AddNumber("--max-probe-interval-ms", o.max_probe_interval_ms, 1u, kDayMs, "ms",
                 "longest time between probes that fail");
  list.AddNumber("--device-stall-ms", o.device_stall_ms, 0u, kDayMs, "ms",
                 "a GPU without progress for this time and ten times its batch's predicted time is treated as lost; 0: "
                 "never");
  list.AddNumber("--max-batch-jobs", o.max_batch_jobs, 1u, 65'536u, "jobs", "most jobs in a batch");
  list.AddNumber("--max-batch-ms", o.max_batch_ms, 0u, kDayMs, "ms", "most predicted work in a batch");
  list.AddBytes("--max-batch-bytes", o.max_batch_bytes, "most bytes of results in a batch");
  list.AddNumber(
      "--batch-delay-us", o.batch_delay_us, 0u, 1'000'000u, "us",
      "how long a worker that has just ended a batch waits for a fuller one; an idle worker takes a job at once");
  list.AddNumber("--giant-job-ms", o.giant_job_ms, 1u, 1'000'000'000u, "ms",
                 "predicted time from which on a job leaves one worker of its device to the other jobs");
}

void AddQueue(OptionList& list, ServerOptions& o) {
  list.Group("The queue");
  list.AddNumber("--max-calls", o.max_calls, 1u, 1'000'000u, "calls",
                 "calls at the same time, including those that send, wait or receive; more are refused with "
                 "RESOURCE_EXHAUSTED and RetryInfo");
  list.AddNumber("--max-connection-calls", o.max_connection_calls, 1u, 1'000'000u, "calls",
                 "of these on one connection; gRPC clients hold further calls back");
  list.AddNumber("--max-queue", o.max_queue, 0u, 1'000'000u, "jobs",
                 "waiting jobs, including those whose mesh is being loaded; more are refused with RESOURCE_EXHAUSTED "
                 "and RetryInfo");
  list.AddBytes("--max-queue-bytes", o.max_queue_bytes,
                "meshes that waiting jobs hold; 0: an eighth of memory, at most 2 GiB");
  list.AddNumber("--max-queue-ms", o.max_queue_ms, uint64_t{0}, uint64_t{1'000'000'000'000}, "ms",
                 "predicted work of the waiting jobs, on one worker");
  list.AddNumber("--queue-timeout-ms", o.queue_timeout_ms, 0u, kDayMs, "ms",
                 "longest time that a job waits, if its request sets none; then DEADLINE_EXCEEDED. 0: no limit");
  list.AddNumber("--queue-aging-ms", o.queue_aging_ms, 0u, kDayMs, "ms",
                 "waiting time after which a job rises by one priority; 0: never");
}

void AddSizes(OptionList& list, ServerOptions& o) {
  list.Group("Sizes");
  list.AddBytes("--max-file-bytes", o.max_file_bytes, 1, "one mesh file; not more than --max-upload-bytes");
  list.AddBytes("--max-upload-bytes", o.max_upload_bytes,
                "all mesh files that are received or wait, together; 0: three sixteenths of memory, at most 4 GiB");
  // The range of 32-bit indices.
  list.AddNumber("--max-triangles", o.max_triangles, uint64_t{1}, uint64_t{UINT32_MAX}, "triangles",
                 "of one mesh, after instancing");
  list.AddNumber("--max-vertices", o.max_vertices, uint64_t{1}, uint64_t{UINT32_MAX}, "vertices",
                 "of one mesh, after instancing");
  list.AddNumber("--max-instances", o.max_instances, uint64_t{1}, uint64_t{UINT32_MAX}, "instances",
                 "in one mesh file");
  list.AddNumber("--max-nodes", o.max_nodes, 1u, UINT32_MAX, "nodes", "in one mesh file");
  list.AddBytes("--max-json-bytes", o.max_json_bytes, 1, "the JSON part of one mesh file");
  list.AddNumber("--max-image-pixels", o.max_image_pixels, uint64_t{1}, uint64_t{65'535} * 65'535, "texels",
                 "of one image; all images of a request together have four times as many");
  list.AddBytes("--max-result-bytes", o.max_result_bytes, 1, "one result");
  list.AddBytes("--max-working-bytes", o.max_working_bytes,
                "memory of all jobs together: their meshes while they are loaded and after, their plans, results that "
                "wait for their clients; 0: three eighths of memory, at most 20 GiB");
  list.AddBytes("--max-transport-bytes", o.max_transport_bytes,
                "messages that gRPC holds; 0: an eighth of memory, at least 128 MiB (two of the largest messages) and "
                "at most 512 MiB");
  list.AddBytes("--max-device-mesh-bytes", o.max_device_mesh_bytes,
                "stored meshes that each GPU keeps in its memory; 0: a quarter of it");
  list.AddBytes("--max-mesh-store-bytes", o.max_mesh_store_bytes,
                "memory of all stored meshes (one whose vertices jobs move counts twice); 0: a sixteenth of memory, at "
                "most 2 GiB");
  list.Add("--share-equal-jobs", o.share_equal_jobs,
           "equal jobs on stored meshes at the same time run once (without a result cache only those predicted to take "
           "0.1 ms or more); false for load tests with equal requests");
  list.AddBytes(
      "--result-cache-bytes", o.result_cache_bytes,
      "results that are kept for equal requests on stored meshes; 0: none; by default 64 MiB with --web-listen, so "
      "that a download needs no second run");
  list.AddNumber("--idle-memory-ms", o.idle_memory_ms, 0u, 1'000'000'000u, "ms",
                 "memory kept for the next jobs is returned to the system if unused for this time; 0: never");
  list.AddNumber(
      "--stream-above-mb", o.stream_above_mb, uint64_t{0}, uint64_t{1} << 30, "MiB",
      "larger dense results are sent slab by slab while they are computed, and take no memory of their size");
}

void AddStreams(OptionList& list, ServerOptions& o) {
  list.Group("Streams");
  list.AddBytes("--piece-bytes", o.piece_bytes, uint64_t{64} << 10, kMaxPieceBytes,
                "of a result in one message; with its header it stays below the 4 MiB that gRPC clients accept by "
                "default");
  list.AddBytes("--stream-buffer-bytes", o.stream_buffer_bytes,
                "pieces of a result that is sent slab by slab and wait for their client; beyond it the worker waits");
  list.AddNumber(
      "--batch-call-jobs", o.batch_call_jobs, 1u, 1'000'000u, "jobs",
      "jobs of one VoxelizeBatch stream in progress; beyond it the stream is not read, but for the other jobs "
      "of a message, 255 at most");
  list.AddBytes("--batch-call-bytes", o.batch_call_bytes, 1, "meshes and results of these jobs");
  list.AddDuration(
      "--max-connection-age-ms,--max-connection-age", o.max_connection_age_ms, kDayMs,
      "a connection is closed (GOAWAY) after about this time (within a tenth), so that clients behind a load "
      "balancer open new ones; 0: never. Also with a unit (30m, 90s), and as --max-connection-age");
  list.AddDuration("--max-connection-age-grace-ms,--max-connection-age-grace", o.max_connection_age_grace_ms, kDayMs,
                   "then: time for its calls to end; 0: no limit");
  list.AddNumber("--zstd-level", o.zstd_level, 1, 19, "",
                 "compression of results whose request sets zstd: 1 is fast, 19 small");
  list.AddNumber("--stall-timeout-ms", o.stall_timeout_ms, 1u, 1'000'000'000u, "ms",
                 "a client that reads nothing of its response for this time is disconnected");
  list.AddNumber("--upload-idle-timeout-ms", o.upload_idle_timeout_ms, 1u, 1'000'000'000u, "ms",
                 "a client that sends less than 64 KiB of its mesh in this time is disconnected");
}

void AddAccess(OptionList& list, ServerOptions& o) {
  list.Group("Access");
  list.Add("--token-file", o.token_file, "FILE",
           "clients with their tokens, roles and quotas (JSON); none: every caller has all rights");
  list.Add("--open-health", o.open_health, "health checks need no token");
  list.Add("--tls-cert", o.tls_cert, "FILE", "the server's certificate chain (PEM); none: plain text");
  list.Add("--tls-key", o.tls_key, "FILE", "the private key of that certificate (PEM), without a passphrase");
  list.Add("--tls-client-ca", o.tls_client_ca, "FILE",
           "mutual TLS: clients need a certificate signed by one of these (PEM); none: they need none");
  list.Add("--tls-client-names", o.tls_client_names,
           "a call without a token belongs to the client that its certificate names, for quotas, fairness and the log");
  list.AddChoice("--isolate-loading", o.isolate_loading, {"auto", "on", "off"},
                 "third-party decoders (Draco, meshopt, PNG, JPEG, WebP) run in sandboxed processes; auto: where "
                 "--listen or --web-listen is beyond loopback");
  list.AddNumber("--reload-interval-ms", o.reload_interval_ms, 100u, kDayMs, "ms",
                 "how often the token and certificate files are checked for changes");
}

void AddLog(OptionList& list, ServerOptions& o) {
  list.Group("Log and shutdown");
  list.AddChoice("--log-level", o.log_level, {"debug", "info", "warn", "error", "off"},
                 "least severe level that is logged");
  list.AddChoice("--log-format", o.log_format, {"text", "json"}, "text for people, json for programs");
  list.AddNumber(
      "--lame-duck-ms", o.lame_duck_ms, 0u, kDayMs, "ms",
      "on SIGTERM: time in which health says NOT_SERVING and calls are still accepted; if not set, 5000 where "
      "--listen is beyond loopback, since load balancers check health every few seconds");
  list.AddNumber("--drain-grace-ms", o.drain_grace_ms, 0u, kDayMs, "ms", "then: time for running calls to end");
}

}  // namespace

ParseOutcome ParseCommandLine(int argc, const char* const* argv) {
  ServerOptions o;
  std::string backend = "auto", simd = "auto", probe, config;
  bool check_config = false, help_markdown = false;
  Program app("voxelpiped", "Voxelizes meshes that clients send over gRPC", VOXELPIPE_VERSION);
  app.SetFooter(
      "Every option is also a VOXELPIPE_ variable (--max-queue: VOXELPIPE_MAX_QUEUE) and a key of the config file "
      "(max-queue). A flag takes precedence over a variable, a variable over the file.");
  app.ShowDefaults();
  OptionList list(app);
  AddServing(list, o);
  AddWork(list, o, backend, simd);
  AddQueue(list, o);
  AddSizes(list, o);
  AddStreams(list, o);
  AddAccess(list, o);
  AddLog(list, o);
  list.Group("On the command line alone");
  list.AddCommand(app.AddOption("--config", config, "read options from this TOML file; also VOXELPIPE_CONFIG"))
      .Type("FILE");
  list.AddCommand(app.AddFlag("--check-config", check_config,
                              "print every option with its value and source, check the files that they name, and "
                              "exit"));
  const Option probe_option =
      list.AddCommand(app.AddOption("--probe", probe,
                                    "ask the server at this address (http://HOST:PORT: its /readyz; none: the one "
                                    "that these options would start) for its health: exit 0 if it serves, else 1"))
          .Type("[HOST:PORT]")
          .Values(0, 1);
  list.AddCommand(app.AddFlag("--help-markdown", help_markdown, "print the tables of server/OPERATIONS.md, and exit"));
  std::vector<OptionValue> values;
  std::optional<ParseStop> stop = ParseFromAllSources(app, argc, argv, values);
  if (!stop) stop = CheckTogether(o, values);
  if (stop && stop->kind == ParseStop::Kind::kAnswered) {
    std::fputs(stop->text.c_str(), stdout);
    return {std::nullopt, 0};
  }
  if (stop) {
    WriteLine(stderr, "voxelpiped: " + UsageError(app, *stop));
    return {std::nullopt, 2};
  }
  if (help_markdown) {
    std::fputs(list.ToMarkdown().c_str(), stdout);
    return {std::nullopt, 0};
  }
  o.backend = kBackends.at(backend);
  o.simd = kSimds.at(simd);
  ChooseDefaults(o, values);
  CommandLine command{o, std::nullopt, check_config, std::move(values)};
  if (probe_option.count() > 0) command.probe = probe.empty() ? ProbeAddress(o) : probe;
  return {command, 0};
}

bool ListensBeyondLoopback(const std::string& listen) {
  for (const char* start : {"127.", "localhost:", "[::1]:", "unix:"}) {
    if (listen.starts_with(start)) return false;
  }
  return true;
}

ServerOptions Resolve(ServerOptions options) {
  const bool for_others = ListensBeyondLoopback(options.listen) ||
                          (!options.web_listen.empty() && ListensBeyondLoopback(options.web_listen));
  if (options.isolate_loading == "auto") options.isolate_loading = for_others ? "on" : "off";
  const int cpus = CpuCount();
  if (options.cpu_workers == 0) options.cpu_workers = options.workers > 0 ? options.workers : std::min(4, cpus);
  options.workers = options.cpu_workers;
  if (options.io_threads == 0) options.io_threads = std::max(1, cpus / 4);
  // Three quarters of the memory together; the rest is the process's own.
  const uint64_t sixteenth = MemoryBytes() / 16;
  const auto choose = [](uint64_t& bytes, uint64_t chosen, uint64_t most, uint64_t least = 1) {
    if (bytes == 0) bytes = std::clamp(chosen, least, most);
  };
  choose(options.max_working_bytes, 6 * sixteenth, 20ull << 30);
  choose(options.max_upload_bytes, 3 * sixteenth, 4ull << 30);
  choose(options.max_transport_bytes, 2 * sixteenth, 512ull << 20, kMinTransportBytes);
  choose(options.max_mesh_store_bytes, sixteenth, 2ull << 30);
  choose(options.max_queue_bytes, 2 * sixteenth, 2ull << 30);  // a share of the memory of uploads and jobs
  if (options.loaders == 0) {
    options.loaders = int(std::clamp<uint64_t>(options.max_working_bytes / kLoaderBytes, 1, uint64_t(cpus)));
  }
  return options;
}

}  // namespace voxelpipe
