// The options of the server. Every option has a flag, an environment variable and a key in the config file.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "job/request.h"
#include "options/option_sources.h"

namespace voxelpipe {

// A message with a full piece, including its header, stays below the 4 MiB that gRPC clients accept by default.
inline constexpr uint64_t kMaxPieceBytes = (uint64_t{4} << 20) - 4096;

// Connections to --web-listen at the same time.
inline constexpr uint32_t kMaxWebConnections = 128;

// Each member is an option of the same name, which options.cpp declares with unit and meaning (OPERATIONS.md, --help).
// Resolve() replaces each 0 that means "choose".
struct ServerOptions {
  std::string listen = "127.0.0.1:50051";
  BackendChoice backend = BackendChoice::kAuto;
  SimdChoice simd = SimdChoice::kAuto;
  int threads = 0;
  int loaders = 0;
  int workers = 0;
  int cpu_workers = 0;
  int io_threads = 0;
  std::string gpus = "all";
  int gpu_streams = 2;
  bool fallback = true;
  uint32_t max_attempts = 3;
  uint32_t probe_interval_ms = 1'000;
  uint32_t max_probe_interval_ms = 60'000;
  uint32_t device_stall_ms = 30'000;
  uint32_t max_queue = 1024;
  uint64_t max_queue_bytes = 0;
  uint64_t max_queue_ms = 600'000;
  uint32_t queue_timeout_ms = 0;
  uint32_t queue_aging_ms = 10'000;
  uint32_t max_batch_jobs = 64;
  uint32_t max_batch_ms = 20;
  uint64_t max_batch_bytes = 64ull << 20;
  uint32_t batch_delay_us = 0;
  uint32_t giant_job_ms = 1000;
  uint32_t max_calls = 4096;
  uint32_t max_connection_calls = 1000;
  uint64_t max_file_bytes = 2ull << 30;
  uint64_t max_upload_bytes = 0;
  uint64_t max_triangles = 50'000'000;
  uint64_t max_vertices = 150'000'000;
  uint64_t max_instances = 10'000'000;
  uint32_t max_nodes = 1'000'000;
  uint64_t max_json_bytes = 64ull << 20;
  uint64_t max_image_pixels = 64ull << 20;
  uint64_t max_device_mesh_bytes = 0;
  uint64_t max_mesh_store_bytes = 0;
  bool share_equal_jobs = true;
  uint64_t result_cache_bytes = 0;
  uint64_t max_result_bytes = 16ull << 30;
  uint64_t stream_above_mb = 512;
  uint64_t max_working_bytes = 0;
  uint64_t max_transport_bytes = 0;
  uint32_t lame_duck_ms = 500;
  uint32_t drain_grace_ms = 30'000;
  uint32_t batch_call_jobs = 256;
  uint64_t batch_call_bytes = 64 << 20;
  uint32_t max_connection_age_ms = 0;
  uint32_t max_connection_age_grace_ms = 0;
  uint64_t piece_bytes = 1 << 20;
  uint64_t stream_buffer_bytes = 4 << 20;
  int zstd_level = 1;
  uint32_t stall_timeout_ms = 60'000;
  uint32_t upload_idle_timeout_ms = 60'000;
  uint32_t idle_memory_ms = 10'000;
  std::string log_level = "info";
  std::string log_format = "text";
  std::string http_listen;
  std::string web_listen, web_origin;
  uint32_t web_connections_per_address = kMaxWebConnections / 4;
  uint64_t export_bytes = 2ull << 30;
  std::string token_file;
  bool open_health = true;
  uint32_t reload_interval_ms = 5000;
  std::string tls_cert, tls_key;
  std::string tls_client_ca;
  bool tls_client_names = false;
  std::string isolate_loading = "auto";
  bool reflection = true;
};

// The parsed command line.
struct CommandLine {
  ServerOptions options;
  std::optional<std::string> probe;  // probe the server at this address instead of serving
  bool check_config = false;         // print `values` instead of serving
  std::vector<OptionValue> values;   // every option with its source
};

// Parses flags, VOXELPIPE_* variables and the config file (option_sources.h: which takes precedence). Out: the options,
// or the exit code after --help, --version and --help-markdown (0) or one line on stderr (2).
struct ParseOutcome {
  std::optional<CommandLine> command;
  int exit_code = 0;
};
ParseOutcome ParseCommandLine(int argc, const char* const* argv);

// True if other machines can reach a server at this address (of --listen).
bool ListensBeyondLoopback(const std::string& listen);

// The same options with every 0 that means "choose" replaced by a value for the current CPUs and memory of this process
// (base/machine.h), except `threads`, where 0 means the current CPUs at any time.
ServerOptions Resolve(ServerOptions options);

}  // namespace voxelpipe
