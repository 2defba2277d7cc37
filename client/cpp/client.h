// A voxelpiped server, called from C++. Speaks the core's own types: no gRPC and no protobuf in this header.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "job/request.h"
#include "load/loader.h"
#include "mesh/report.h"
#include "pipeline/plan/plan.h"
#include "pipeline/voxelize.h"
#include "shaders/catalog.h"
#include "wire/call_settings.h"

namespace voxelpipe {

// How a client shows who it is, and whom it believes. Files are PEM; an empty name means none.
struct ClientTls {
  std::string ca_file;              // of those whom it believes; empty: those whom this machine believes
  std::string cert_file, key_file;  // the client's own, where the server asks for one
  std::string server_name;          // what the certificate must be for, where that is not the target's host
};

struct ConnectOptions {
  std::optional<ClientTls> tls;             // absent: plain text
  std::string token;                        // sent with each call: `authorization: Bearer TOKEN`; empty: none
  std::chrono::milliseconds timeout{5000};  // for the connection to stand
  uint64_t max_result_bytes = 64ull << 30;  // a server that announces more is not believed
  CallSettings settings;                    // how the results of all calls are made and sent
};

// How a server came to run a job.
struct ServedBy {
  std::string worker;       // "cpu/0", "cuda:1/0"; empty where the server does not report it, or the result was cached
  double queue_ms = 0;      // from admission to the worker
  uint32_t batch_jobs = 0;  // jobs of the worker's pass, this one included
  std::optional<uint64_t> batch_launches;  // kernel launches of that pass; CUDA only
  uint32_t attempts = 0;                   // workers that were given the job; more than 1 where a device failed
};

// What a server says about a run besides its result.
struct RemoteRun {
  ServedBy served;
  VoxelizeStats stats;  // the server's figures, and its warnings
  // The server's "load" and "flatten", wall milliseconds; the stages of the pipeline are in stats.stages.
  std::vector<std::pair<std::string, double>> mesh_stages;
  MeshReport report;
  uint64_t peak_bytes = 0;  // the server's peak for this request
  bool cached = false;      // the result was kept from an equal request, or made for one at the same time
  // Of the result's bytes in stream order, 64 hexadecimal digits, checked on arrival; empty where settings.content_hash
  // is false.
  std::string content_sha256;
  uint64_t sent_bytes = 0;  // of the result as they came, compressed or not
};

// What one mesh gave, in memory.
struct RemoteResult : RemoteRun {
  // As the core gives it; `specs` is what was asked for, `stats` the same as above.
  VoxelizeResult result;
};

// A mesh that the server keeps.
struct StoredMesh {
  std::string mesh_id;                    // SHA-256 of the file's bytes, 64 hexadecimal digits
  MeshFormat format = MeshFormat::kAuto;  // of the file
  uint64_t file_bytes = 0;
  uint64_t memory_bytes = 0;    // that it takes on the server
  MeshReport report;            // degenerate triangles and open edges are 0 until a job with a fill used the mesh
  WarningList warnings;         // all of its textures included
  uint64_t uses = 0;            // jobs that took it
  bool already_stored = false;  // UploadMesh: it was there
};

struct ServerBackend {
  std::string name;  // "cpu", "cuda"
  std::string simd;  // instruction set of its row kernels
};

struct ServerDevice {
  std::string name;           // "cpu", "cuda:0"
  std::string backend;        // "cpu", "cuda"
  std::string model;          // as its maker calls it; empty where that is not known
  uint64_t memory_bytes = 0;  // of its own
  uint32_t workers = 0;       // batches that run on it at the same time
  bool serving = true;
  std::string reason;  // why it does not
};

// What a server is and what it allows.
struct ServerDescription {
  std::vector<ServerDevice> devices;
  std::string version;
  std::vector<ServerBackend> backends;  // best first
  uint32_t threads = 0;                 // of the CPU backend, shared by the requests that run
  uint32_t workers = 0;                 // meshes that are loaded at the same time; `devices` has what runs
  uint32_t max_queue = 0;               // requests that wait
  uint64_t max_file_bytes = 0;
  uint64_t max_result_bytes = 0;
  uint64_t max_working_bytes = 0;
  uint64_t max_triangles = 0;
  uint64_t max_message_bytes = 0;     // of one request message; Voxelize sends smaller ones whatever the mesh's size
  uint64_t max_mesh_store_bytes = 0;  // memory of all meshes that are kept
};

// True if an error says that no connection to the server was made, so that nothing was sent.
bool IsConnectError(const absl::Status& status);

class ManyStream;  // many_stream.h

// Thread-safe. Errors of all calls carry the server's code and message; a lost or refused connection is UNAVAILABLE
// naming the target.
class Client {
 public:
  // In: "HOST:PORT" or any gRPC target ("unix:/path"). UNAVAILABLE naming the target when no server answers there or
  // TLS does not come about, at once where the connection is refused time and again, else after `options.timeout`.
  // INVALID_ARGUMENT naming a file of `options.tls` that cannot be read.
  static absl::StatusOr<std::unique_ptr<Client>> Connect(const std::string& target, const ConnectOptions& options = {});
  ~Client();
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  // In: the bytes of a self-contained mesh file (ReadAndPackMeshFile) and a request. `job`: Cancel() ends the call
  // within some ten milliseconds and the server's work with it; the deadline is sent along; Progress is called with
  // "upload", the server's stage names and "download", from one thread at a time. `on_plan`, if set, is called once, on
  // the calling thread, before the result comes.
  // Errors: the server's (see Voxelize in pipeline/voxelize.h); CANCELLED, DEADLINE_EXCEEDED; DATA_LOSS where the
  // result fails its checks (offsets, lengths, CRC32C of every piece, SHA-256 of the whole, sizes against the request;
  // of sparse and bucketed results also that the lists agree with each other, see list_check.h).
  absl::StatusOr<RemoteResult> Voxelize(std::span<const uint8_t> mesh_bytes, MeshFormat format,
                                        const VoxelizeRequest& request, const JobContext& job,
                                        const std::function<void(const Plan&)>& on_plan = {});

  // The same for a result that need not fit into this machine's memory: `sink` gets it as it comes, on the calling
  // thread; its errors end the call and are returned. What DATA_LOSS means is found at the end: the SHA-256 after all
  // bytes were handed on, so the sink's bytes count only when this returns OK (every piece by itself has passed its
  // CRC32C). Whether the lists of sparse and bucketed results agree with each other is not checked. Sink::Keep is not
  // called.
  absl::StatusOr<RemoteRun> VoxelizeTo(std::span<const uint8_t> mesh_bytes, MeshFormat format,
                                       const VoxelizeRequest& request, const JobContext& job, ResultSink& sink,
                                       const std::function<void(const Plan&)>& on_plan = {});

  // Sends a mesh to be kept, unless the server has it already (the bytes' SHA-256 goes first). It stays until it is
  // deleted or others were used later and need the room. `job`: as of Voxelize; Progress is called with "upload".
  // Errors: as of Voxelize for a broken file; RESOURCE_EXHAUSTED where it is larger than all that the server keeps;
  // DATA_LOSS where other bytes arrive than were sent.
  absl::StatusOr<StoredMesh> UploadMesh(std::span<const uint8_t> mesh_bytes, MeshFormat format, const JobContext& job);

  // Voxelize and VoxelizeTo with a mesh that the server keeps: the same bytes as with its file. NOT_FOUND where the
  // server has none of that id (any more): UploadMesh sends it again. `new_positions`, if not empty: x, y, z of every
  // vertex of the flattened mesh (report.vertices of them, in the order of the file's nodes and primitives), in world
  // units, used in place of the mesh's own; everything else stays, normals too. Skeletons and morph targets do not move
  // such a mesh. INVALID_ARGUMENT for another number, or naming the first vertex that is not finite.
  absl::StatusOr<RemoteResult> VoxelizeStored(const std::string& mesh_id, const VoxelizeRequest& request,
                                              const JobContext& job, std::span<const float> new_positions = {},
                                              const std::function<void(const Plan&)>& on_plan = {});
  absl::StatusOr<RemoteRun> VoxelizeStoredTo(const std::string& mesh_id, const VoxelizeRequest& request,
                                             const JobContext& job, ResultSink& sink,
                                             std::span<const float> new_positions = {},
                                             const std::function<void(const Plan&)>& on_plan = {});

  // The server's record of a mesh. NOT_FOUND where it does not keep it.
  absl::StatusOr<StoredMesh> GetMesh(const std::string& mesh_id);
  // Takes this client's claim on a mesh back, and makes the server forget the mesh where no other client has one; jobs
  // that use it go on. Out: the bytes that this frees, 0 where it stays for others. NOT_FOUND where the server does not
  // keep it, PERMISSION_DENIED without a claim.
  absl::StatusOr<uint64_t> DeleteMesh(const std::string& mesh_id);

  // Opens a stream for many small jobs (many_stream.h). At most `window` of them are unanswered at a time. `job`:
  // Cancel() ends the stream, its deadline is the stream's; it must outlive the stream, as must this client.
  std::unique_ptr<ManyStream> OpenMany(const JobContext& job, size_t window = 64);

  struct Estimated {
    Plan plan;
    MeshReport report;  // what the server saw in the mesh
  };
  // The plan of the same request without the work. Sends the whole mesh in one message: for files below the server's
  // max_message_bytes.
  absl::StatusOr<Estimated> Estimate(std::span<const uint8_t> mesh_bytes, MeshFormat format,
                                     const VoxelizeRequest& request, const JobContext& job);
  // The same for a mesh that is known by its size and the box of its vertices after the vertex shader.
  absl::StatusOr<Plan> Estimate(uint64_t triangles, uint64_t vertices, const Box3d& shaded_box,
                                const VoxelizeRequest& request, const JobContext& job);

  // The same for a mesh that the server keeps.
  absl::StatusOr<Estimated> EstimateStored(const std::string& mesh_id, const VoxelizeRequest& request,
                                           const JobContext& job);

  // The server's shaders, vertex shaders first.
  absl::StatusOr<std::vector<ShaderInfo>> ListShaders();

  absl::StatusOr<ServerDescription> ServerInfo();

  // OK while the server takes requests; UNAVAILABLE when it is draining or not there.
  absl::Status CheckHealth(std::chrono::milliseconds timeout = std::chrono::seconds(3));

  const std::string& target() const;

 private:
  struct Impl;
  explicit Client(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace voxelpipe
