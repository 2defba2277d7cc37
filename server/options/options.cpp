#include "options/options.h"

#include <algorithm>
#include <map>
#include <type_traits>

#include <CLI/CLI.hpp>

#include "base/machine.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kMaxBytes = uint64_t{1} << 60;
// What loading one mesh may well take.
constexpr uint64_t kLoaderBytes = 64 << 20;
// Two of the largest messages (service_state.h).
constexpr uint64_t kMinTransportBytes = 128 << 20;
constexpr uint32_t kDayMs = 86'400'000;
// Load balancers look at health every few seconds.
constexpr uint32_t kLameDuckBeyondLoopbackMs = 5'000;

const std::map<std::string, uint64_t> kTimeUnits = {{"ms", 1}, {"s", 1000}, {"m", 60'000}, {"h", 3'600'000}};

const std::map<std::string, BackendChoice> kBackends = {
    {"auto", BackendChoice::kAuto}, {"cpu", BackendChoice::kCpu}, {"cuda", BackendChoice::kCuda}};

const std::map<std::string, SimdChoice> kSimds = {{"auto", SimdChoice::kAuto},
                                                  {"scalar", SimdChoice::kScalar},
                                                  {"avx2", SimdChoice::kAvx2},
                                                  {"avx512", SimdChoice::kAvx512}};

// Where a probe of this machine's own server goes: the listening address, with the wildcard replaced by loopback.
std::string ProbeAddress(const ServerOptions& options) {
  // Over HTTP no certificate and no token is in the way.
  if (!options.http_listen.empty()) return "http://" + options.http_listen;
  const std::string& listen = options.listen;
  if (listen.starts_with("0.0.0.0:")) return "127.0.0.1" + listen.substr(7);
  if (listen.starts_with("[::]:")) return "[::1]" + listen.substr(4);
  return listen;
}

// What is wrong with a value of --gpus; empty: nothing.
std::string CheckGpus(std::string& text) {
  if (text == "all" || text == "none") return "";
  for (size_t at = 0, comma; at <= text.size(); at = comma + 1) {
    comma = std::min(text.find(',', at), text.size());
    const bool digits = comma > at && text.find_first_not_of("0123456789", at) >= comma;
    if (!digits) return "not all, none or numbers with commas between them: " + text;
  }
  return "";
}

// What is wrong with HOST:PORT; empty: nothing. gRPC takes port 99999 for 34463, and ::1 for port 1 of the host ":".
std::string CheckHostPort(std::string& text) {
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
std::string CheckListen(std::string& text) {
  if (!text.starts_with("unix:")) return CheckHostPort(text);
  return text == "unix:" ? "unix: without the path of a socket" : "";
}

// Of the HTTP port's.
std::string CheckHttpListen(std::string& text) {
  return text.empty() ? "" : CheckHostPort(text);
}

// Unsigned numbers would be taken modulo 2^64.
std::string CheckNotNegative(std::string& text) {
  return text.find('-') == std::string::npos ? "" : "must not be negative: " + text;
}

// What no option of its own can tell: one that was set and does not go together with another one. Throws ValidationError.
void CheckTogether(const ServerOptions& options, const std::vector<OptionValue>& values) {
  for (const OptionValue& value : values) {
    if (value.key != "max-file-bytes" || value.source == "default") continue;
    if (options.max_upload_bytes == 0 || options.max_file_bytes <= options.max_upload_bytes) continue;
    const std::string flag = "--" + value.key;
    throw CLI::ValidationError(
        value.source == "flag" ? flag : value.source + ": " + flag,
        value.value + " is more than --max-upload-bytes, " + std::to_string(options.max_upload_bytes));
  }
}

// The defaults that depend on other options.
void ChooseDefaults(ServerOptions& options, std::vector<OptionValue>& values) {
  for (OptionValue& value : values) {
    if (value.key != "lame-duck-ms" || value.source != "default") continue;
    if (ListensBeyondLoopback(options.listen)) options.lame_duck_ms = kLameDuckBeyondLoopbackMs;
    value.value = std::to_string(options.lame_duck_ms);
  }
}

}  // namespace

ParseOutcome ParseCommandLine(int argc, const char* const* argv) {
  ServerOptions o;
  std::string backend = "auto", simd = "auto", probe, config;
  bool check_config = false;
  CLI::App app{"Voxelizes meshes that clients send over gRPC", "voxelpiped"};
  app.set_version_flag("--version", VOXELPIPE_VERSION);
  app.footer(
      "Every option is also a VOXELPIPE_ variable (--max-queue: VOXELPIPE_MAX_QUEUE) and a key of the config file "
      "(max-queue). A flag is stronger than a variable, a variable than the file.");
  app.option_defaults()->always_capture_default();
  const auto add = [&](const std::string& flag, auto& value, const std::string& help) {
    CLI::Option* const option = app.add_option(flag, value, help);
    using Value = std::remove_reference_t<decltype(value)>;
    if constexpr (std::is_unsigned_v<Value> && !std::is_same_v<Value, bool>) {
      option->transform(CLI::Validator(CheckNotNegative, ""));
    }
    return option;
  };
  const auto add_bytes = [&](const std::string& flag, uint64_t& value, const std::string& help) {
    // What was added last is looked at first.
    return app.add_option(flag, value, help)
        ->transform(CLI::AsSizeValue(false))
        ->transform(CLI::Validator(CheckNotNegative, ""))
        ->check(CLI::Range(uint64_t{0}, kMaxBytes));
  };
  // A size without which nothing would ever be served.
  const auto add_size = [&](const std::string& flag, uint64_t& value, const std::string& help) {
    return add_bytes(flag, value, help)->check(CLI::Range(uint64_t{1}, kMaxBytes));
  };
  add("--listen", o.listen, "Address to serve on; port 0 picks one; unix:/PATH for a socket")
      ->check(CLI::Validator(CheckListen, "HOST:PORT"));
  add("--backend", backend, "Kind of worker")->check(CLI::IsMember(kBackends));
  add("--simd", simd, "Instruction set of the CPU backend where the request leaves it open")
      ->check(CLI::IsMember(kSimds));
  add("--threads", o.threads, "Threads of the CPU backend, shared by the jobs of a batch, 0 for one a CPU")
      ->check(CLI::Range(0, 1024));
  add("--io-threads", o.io_threads, "Threads that serve connections, 0 for one for each four CPUs")
      ->check(CLI::Range(0, 16));
  add("--loaders", o.loaders,
      "Meshes that are loaded at the same time, 0 to choose: one a CPU, fewer where there is less than 64 MiB of "
      "--max-working-bytes for each")
      ->check(CLI::Range(0, 1024));
  add("--workers", o.workers, "Batches on the CPU at the same time, 0 to choose: one a CPU, at most 4")
      ->check(CLI::Range(0, 1024));
  add("--cpu-workers", o.cpu_workers, "The same as --workers, and stronger, 0 for what --workers says")
      ->check(CLI::Range(0, 1024));
  add("--gpus", o.gpus, "GPUs to use: all, none, or their numbers with commas between them")
      ->check(CLI::Validator(CheckGpus, "all|none|N,N..."));
  add("--gpu-streams", o.gpu_streams, "Batches on one GPU at the same time")->check(CLI::Range(1, 64));
  add("--fallback", o.fallback, "Whether another kind of worker may do what the chosen kind cannot do now");
  add("--max-attempts", o.max_attempts, "Workers that are given a job whose devices fail")->check(CLI::Range(1u, 100u));
  add("--probe-interval-ms", o.probe_interval_ms,
      "From a device's quarantine to its first probe; twice as long after each that fails")
      ->check(CLI::Range(1u, 86'400'000u));
  add("--max-probe-interval-ms", o.max_probe_interval_ms, "Between probes that fail, at most")
      ->check(CLI::Range(1u, 86'400'000u));
  add("--device-stall-ms", o.device_stall_ms,
      "Take a GPU for lost that gives no sign of life for so long and ten times its batch's predicted time, 0 for "
      "never")
      ->check(CLI::Range(0u, kDayMs));
  add("--max-queue", o.max_queue, "Jobs that wait, those included whose mesh is being loaded")
      ->check(CLI::Range(0u, 1'000'000u));
  add("--max-calls", o.max_calls, "Calls at the same time, those included that send, wait or receive")
      ->check(CLI::Range(1u, 1'000'000u));
  add("--max-connection-calls", o.max_connection_calls, "Calls at the same time on one connection")
      ->check(CLI::Range(1u, 1'000'000u));
  add_bytes("--max-queue-bytes", o.max_queue_bytes, "Meshes that waiting jobs hold, 0 to choose");
  add("--max-queue-ms", o.max_queue_ms, "Predicted work of the jobs that wait, on one worker")
      ->check(CLI::Range(uint64_t{0}, uint64_t{1'000'000'000'000}));
  add("--queue-timeout-ms", o.queue_timeout_ms,
      "A job waits at most so long for a worker, if its request does not say; 0: no limit")
      ->check(CLI::Range(0u, kDayMs));
  add("--queue-aging-ms", o.queue_aging_ms, "A job that has waited so long rises by one priority; 0: never")
      ->check(CLI::Range(0u, kDayMs));
  add("--max-batch-jobs", o.max_batch_jobs, "Jobs that a worker takes together")->check(CLI::Range(1u, 65'536u));
  add("--max-batch-ms", o.max_batch_ms, "Predicted work of a batch")->check(CLI::Range(0u, kDayMs));
  add_bytes("--max-batch-bytes", o.max_batch_bytes, "Results of a batch");
  add("--batch-delay-us", o.batch_delay_us, "A worker that has ended a batch waits so long for a fuller one")
      ->check(CLI::Range(0u, 1'000'000u));
  add("--giant-job-ms", o.giant_job_ms,
      "Predicted; of the workers of a device all but one run such jobs or larger ones at the same time")
      ->check(CLI::Range(1u, 1'000'000'000u));
  add_size("--max-file-bytes", o.max_file_bytes, "Largest mesh file");
  add_bytes("--max-upload-bytes", o.max_upload_bytes, "All mesh files in hand together, 0 to choose");
  // What indices of 32 bits can name.
  const auto add_count = [&](const std::string& flag, auto& value, const std::string& help) {
    using Value = std::remove_reference_t<decltype(value)>;
    add(flag, value, help)->check(CLI::Range(Value{1}, Value{UINT32_MAX}));
  };
  add_count("--max-triangles", o.max_triangles, "Triangles of one mesh, after instancing");
  add_count("--max-vertices", o.max_vertices, "Vertices of one mesh, after instancing");
  add_count("--max-instances", o.max_instances, "Instances in one mesh file");
  add_count("--max-nodes", o.max_nodes, "Nodes in one mesh file");
  add_size("--max-json-bytes", o.max_json_bytes, "JSON of one mesh file");
  add("--max-image-pixels", o.max_image_pixels, "Texels of one image; all of a request: four times as many")
      ->check(CLI::Range(uint64_t{1}, uint64_t{65'535} * 65'535));
  add_bytes("--max-device-mesh-bytes", o.max_device_mesh_bytes, "Meshes that each GPU keeps, 0 to choose");
  add_bytes("--max-mesh-store-bytes", o.max_mesh_store_bytes, "Memory of all meshes that are kept, 0 to choose");
  add("--share-equal-jobs", o.share_equal_jobs, "Whether equal jobs on kept meshes at the same time are run once");
  add_bytes("--result-cache-bytes", o.result_cache_bytes,
            "Results that are kept for equal requests on kept meshes, 0 for none");
  add_size("--max-result-bytes", o.max_result_bytes, "Largest result");
  add_bytes("--max-working-bytes", o.max_working_bytes,
            "Memory of all jobs together, meshes and results included, 0 to choose");
  add_bytes("--max-transport-bytes", o.max_transport_bytes, "Messages in gRPC's hands, 0 to choose");
  add("--stream-above-mb", o.stream_above_mb,
      "MiB: larger dense results leave slab by slab while they are made, and bound no memory by their size")
      ->check(CLI::Range(uint64_t{0}, uint64_t{1} << 30));
  add("--many-in-flight", o.many_in_flight, "Jobs of one VoxelizeMany stream in hand; it is not read beyond")
      ->check(CLI::Range(1u, 1'000'000u));
  add_size("--many-bytes", o.many_bytes,
           "Meshes and results of one VoxelizeMany stream in hand; it is not read beyond");
  add_bytes("--piece-bytes", o.piece_bytes, "Bytes of a result in one message")
      ->check(CLI::Range(uint64_t{64} << 10, kMaxPieceBytes));
  add_bytes("--stream-buffer-bytes", o.stream_buffer_bytes,
            "Pieces of one result that leaves slab by slab and wait for their client; its worker waits beyond that");
  add("--zstd-level", o.zstd_level, "Compression of results whose request asks for it: 1 is fast, 19 small")
      ->check(CLI::Range(1, 19));
  add("--stall-timeout-ms", o.stall_timeout_ms, "Let a client go that takes nothing of its answer for so long")
      ->check(CLI::Range(1u, 1'000'000'000u));
  add("--upload-idle-timeout-ms", o.upload_idle_timeout_ms,
      "Let a client go that sends less than 64 KiB of its mesh in so long")
      ->check(CLI::Range(1u, 1'000'000'000u));
  add("--idle-memory-ms", o.idle_memory_ms,
      "Memory that is kept for the next jobs goes back to the system when it was not used for so long, 0: never")
      ->check(CLI::Range(0u, 1'000'000'000u));
  add("--max-connection-age-ms,--max-connection-age", o.max_connection_age_ms,
      "A connection is told to end after about so long, so that its client opens a new one (30m, 90s, 1500ms); 0: "
      "never")
      ->transform(CLI::AsNumberWithUnit(kTimeUnits))
      ->check(CLI::Range(0u, kDayMs));
  add("--max-connection-age-grace-ms,--max-connection-age-grace", o.max_connection_age_grace_ms,
      "Then: time in which its calls may end; 0: as long as they take")
      ->transform(CLI::AsNumberWithUnit(kTimeUnits))
      ->check(CLI::Range(0u, kDayMs));
  add("--lame-duck-ms", o.lame_duck_ms,
      "On SIGTERM: time in which calls are still taken; if not set, 5000 where it listens beyond loopback")
      ->check(CLI::Range(0u, kDayMs));
  add("--drain-grace-ms", o.drain_grace_ms, "Then: time in which running calls may end")->check(CLI::Range(0u, kDayMs));
  add("--log-level", o.log_level, "Least severe level that is logged")
      ->check(CLI::IsMember({"debug", "info", "warn", "error", "off"}));
  add("--log-format", o.log_format, "Lines for people or for programs")->check(CLI::IsMember({"text", "json"}));
  add("--http-listen", o.http_listen,
      "Address of /metrics, /livez and /readyz over HTTP; port 0 picks one, empty: none")
      ->check(CLI::Validator(CheckHttpListen, "HOST:PORT"));
  add("--token-file", o.token_file,
      "Clients with their tokens, roles and quotas (JSON); empty: everybody may do everything")
      ->type_name("FILE");
  add("--open-health", o.open_health, "Whether health is told without a token");
  add("--reload-interval-ms", o.reload_interval_ms, "How often changed tokens and certificates are looked for")
      ->check(CLI::Range(100u, 86'400'000u));
  add("--isolate-loading", o.isolate_loading,
      "Whether decoders that others wrote (Draco, meshopt, PNG, JPEG, WebP) run in processes of their own, which may "
      "do nothing else; auto: "
      "where other machines can reach the server")
      ->check(CLI::IsMember({"auto", "on", "off"}));
  add("--tls-cert", o.tls_cert, "The server's certificate chain (PEM); empty: plain text")->type_name("FILE");
  add("--tls-key", o.tls_key, "The key of that certificate (PEM)")->type_name("FILE");
  add("--tls-client-ca", o.tls_client_ca,
      "Clients need a certificate that one of these signed (PEM); empty: they need none")
      ->type_name("FILE");
  add("--tls-client-names", o.tls_client_names,
      "Whether a call without a token is the client's that its certificate names, for quotas, fairness and the log");
  add("--reflection", o.reflection, "Whether clients may ask for the descriptions of the services");
  app.add_option("--config", config, "Read options from this TOML file")->type_name("FILE")->configurable(false);
  app.add_flag("--check-config", check_config, "Print every option and where it comes from, say what is wrong, and end")
      ->configurable(false);
  CLI::Option* probe_option = app.add_option("--probe", probe,
                                             "Ask the server at this address (http://HOST:PORT: /readyz there; none: "
                                             "its own) for its health: exit 0 if it serves, "
                                             "else 1")
                                  ->type_name("[HOST:PORT]")
                                  ->expected(0, 1)
                                  ->configurable(false);
  std::vector<OptionValue> values;
  try {
    values = ParseFromAllSources(app, argc, argv);
    CheckTogether(o, values);
  } catch (const CLI::ParseError& error) {
    return {std::nullopt, app.exit(error) == 0 ? 0 : 2};
  }
  o.backend = kBackends.at(backend);
  o.simd = kSimds.at(simd);
  ChooseDefaults(o, values);
  CommandLine command{o, std::nullopt, check_config, std::move(values)};
  if (probe_option->count() > 0) command.probe = probe.empty() ? ProbeAddress(o) : probe;
  return {command, 0};
}

bool ListensBeyondLoopback(const std::string& listen) {
  for (const char* start : {"127.", "localhost:", "[::1]:", "unix:"}) {
    if (listen.starts_with(start)) return false;
  }
  return true;
}

ServerOptions Resolve(ServerOptions options) {
  if (options.isolate_loading == "auto") options.isolate_loading = ListensBeyondLoopback(options.listen) ? "on" : "off";
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
  choose(options.max_queue_bytes, 2 * sixteenth, 2ull << 30);  // a part of what uploads and jobs have
  if (options.loaders == 0) {
    options.loaders = int(std::clamp<uint64_t>(options.max_working_bytes / kLoaderBytes, 1, uint64_t(cpus)));
  }
  return options;
}

}  // namespace voxelpipe
