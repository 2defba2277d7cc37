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

struct ServerOptions {
  std::string listen = "127.0.0.1:50051";  // HOST:PORT (port 0 picks one) or unix:PATH
  BackendChoice backend = BackendChoice::kAuto;
  SimdChoice simd = SimdChoice::kAuto;      // where the request leaves it open
  int threads = 0;                          // of the CPU backend in one job; 0 = one a CPU
  int loaders = 0;                          // meshes that are loaded at the same time; 0 = one a CPU, as memory allows
  int workers = 0;                          // batches on the CPU at the same time; 0 = one a CPU, at most 4
  int cpu_workers = 0;                      // the same, and stronger; 0 = not given
  int io_threads = 0;                       // of gRPC's, that read and write; 0 = one for each four CPUs
  std::string gpus = "all";                 // or "none", or their numbers: "0,2"
  int gpu_streams = 2;                      // jobs or batches on one GPU at the same time
  bool fallback = true;                     // another kind of worker may do what the chosen kind cannot
  uint32_t max_attempts = 3;                // workers that are given a job whose devices fail
  uint32_t probe_interval_ms = 1'000;       // from a device's quarantine to its first probe
  uint32_t max_probe_interval_ms = 60'000;  // between probes that fail, at most
  uint32_t device_stall_ms = 30'000;        // a GPU without a sign of life for so long is lost; 0 = never
  uint32_t max_queue = 1024;                // jobs that wait
  uint64_t max_queue_bytes = 0;             // meshes that these hold; 0 = an eighth of memory, at most 2 GiB
  uint64_t max_queue_ms = 600'000;          // predicted work of these, on one worker
  uint32_t queue_timeout_ms = 0;            // a job waits at most so long, if its request does not say; 0 = no limit
  uint32_t queue_aging_ms = 10'000;         // a job that has waited so long rises by one priority; 0 = never
  uint32_t max_batch_jobs = 64;             // jobs that a worker takes together
  uint32_t max_batch_ms = 20;               // predicted work of these
  uint64_t max_batch_bytes = 64ull << 20;   // results of these
  uint32_t batch_delay_us = 0;              // a worker that comes from work waits so long for a fuller batch
  uint32_t giant_job_ms = 1000;             // predicted; jobs from here on leave one worker of a device to the others
  uint32_t max_calls = 4096;                // calls at the same time, those included that send, wait or receive
  uint32_t max_connection_calls = 1000;     // of them on one connection; a client's library holds back more
  uint64_t max_file_bytes = 2ull << 30;     // one mesh file
  uint64_t max_upload_bytes = 0;            // mesh files received or waiting; 0 = 3/16 of memory, at most 4 GiB
  uint64_t max_triangles = 50'000'000;      // of one mesh, after instancing
  uint64_t max_vertices = 150'000'000;      // likewise
  uint64_t max_instances = 10'000'000;      // likewise
  uint32_t max_nodes = 1'000'000;           // of one file
  uint64_t max_json_bytes = 64ull << 20;    // of one file
  uint64_t max_image_pixels = 64ull << 20;  // of one texture; all of a request together four times as many
  uint64_t max_device_mesh_bytes = 0;       // meshes that each GPU keeps; 0 = a quarter of its memory
  uint64_t max_mesh_store_bytes = 0;        // all meshes that are kept; 0 = a sixteenth of memory, at most 2 GiB
  bool share_equal_jobs = true;             // equal jobs on kept meshes at the same time are run once
  uint64_t result_cache_bytes = 0;          // results that are kept for equal requests; 0 = none
  uint64_t max_result_bytes = 16ull << 30;  // one result
  uint64_t stream_above_mb = 512;           // MiB: larger dense results leave slab by slab while they are made
  uint64_t max_working_bytes = 0;           // meshes, plans and results of all jobs; 0 = 3/8 of memory, at most 20 GiB
  uint64_t max_transport_bytes = 0;         // messages in gRPC's hands; 0 = an eighth of memory, 128 to 512 MiB
  uint32_t lame_duck_ms = 500;       // after SIGTERM: health says NOT_SERVING, calls are still taken. If it is not set,
                                     // ParseCommandLine makes it 5000 where the server listens beyond loopback
  uint32_t drain_grace_ms = 30'000;  // then: calls that run may still end
  uint32_t many_in_flight = 256;     // jobs of one VoxelizeMany stream in hand; it is not read beyond
  uint64_t many_bytes = 64 << 20;    // meshes and results of these
  uint32_t max_connection_age_ms = 0;        // a connection is told to end after about so long; 0: never
  uint32_t max_connection_age_grace_ms = 0;  // its calls may go on for so long then; 0: until they end by themselves
  uint64_t piece_bytes = 1 << 20;            // of a result in one message; at most kMaxPieceBytes
  uint64_t stream_buffer_bytes = 4 << 20;    // pieces of a result that leaves slab by slab, waiting for one client
  int zstd_level = 1;                        // where a request asks for compression
  uint32_t stall_timeout_ms = 60'000;        // a client that takes no message of its answer for so long is let go
  uint32_t upload_idle_timeout_ms = 60'000;  // a client that sends less than 64 KiB of its mesh in so long is let go
  uint32_t idle_memory_ms =
      10'000;  // memory that is kept for later goes to the system when unused for so long; 0: never
  std::string log_level = "info";
  std::string log_format = "text";  // or "json"
  std::string http_listen;          // HOST:PORT of /metrics, /livez and /readyz; empty: none
  std::string token_file;           // clients, roles and quotas (access/tokens.h); empty: everybody may do everything
  bool open_health = true;          // health is told without a token
  uint32_t reload_interval_ms = 5000;    // how often changed tokens and certificates are looked for
  std::string tls_cert, tls_key;         // PEM files of the server's certificate chain and its key; empty: plain text
  std::string tls_client_ca;             // PEM file of those who sign clients' certificates; empty: clients need none
  bool tls_client_names = false;         // a call without a token is the client's that its certificate names
  std::string isolate_loading = "auto";  // "on", "off": decoders that others wrote run in processes of their own
  bool reflection = true;                // clients may ask for the descriptions of the services
};

// What the command line asks for.
struct CommandLine {
  ServerOptions options;
  std::optional<std::string> probe;  // ask the server at this address for its health instead of serving
  bool check_config = false;         // print `values` instead of serving
  std::vector<OptionValue> values;   // every option and where it comes from
};

// Parses flags, VOXELPIPE_* variables and the config file (option_sources.h says which is stronger). Out: what to do, or the exit code
// after help (0) or one clear line on stderr (2).
struct ParseOutcome {
  std::optional<CommandLine> command;
  int exit_code = 0;
};
ParseOutcome ParseCommandLine(int argc, const char* const* argv);

// Whether other machines may reach a server at this address (of --listen).
bool ListensBeyondLoopback(const std::string& listen);

// The same options with every 0 that means "choose" replaced by what suits the CPUs and the memory of this process now (base/machine.h),
// but for `threads`, where 0 means the CPUs at any time.
ServerOptions Resolve(ServerOptions options);

}  // namespace voxelpipe
