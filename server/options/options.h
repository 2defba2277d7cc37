// What an operator may set. Every option has a flag, an environment variable and a key in the config file.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "job/request.h"
#include "options/option_sources.h"

namespace voxelpipe {

// A message with a full piece stays below the 4 MiB that clients of gRPC take by default: the rest is its header's.
inline constexpr uint64_t kMaxPieceBytes = (uint64_t{4} << 20) - 4096;

// An option of the same name each, which options.cpp declares with its unit and meaning (OPERATIONS.md, --help). Where
// 0 means "choose", Resolve() does.
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
  uint32_t many_in_flight = 256;
  uint64_t many_bytes = 64 << 20;
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
  std::string token_file;
  bool open_health = true;
  uint32_t reload_interval_ms = 5000;
  std::string tls_cert, tls_key;
  std::string tls_client_ca;
  bool tls_client_names = false;
  std::string isolate_loading = "auto";
  bool reflection = true;
};

// What the command line asks for.
struct CommandLine {
  ServerOptions options;
  std::optional<std::string> probe;  // ask the server at this address for its health instead of serving
  bool check_config = false;         // print `values` instead of serving
  std::vector<OptionValue> values;   // every option and where it comes from
};

// Parses flags, VOXELPIPE_* variables and the config file (option_sources.h: which takes precedence). Out: what to do,
// or the exit code after --help, --version and --help-markdown (0) or one line on stderr (2).
struct ParseOutcome {
  std::optional<CommandLine> command;
  int exit_code = 0;
};
ParseOutcome ParseCommandLine(int argc, const char* const* argv);

// True if other machines can reach a server at this address (of --listen).
bool ListensBeyondLoopback(const std::string& listen);

// The same options with every 0 that means "choose" replaced by what suits the CPUs and the memory of this process now
// (base/machine.h), except `threads`, where 0 means the CPUs at any time.
ServerOptions Resolve(ServerOptions options);

}  // namespace voxelpipe
