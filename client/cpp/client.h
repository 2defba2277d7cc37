// The C++ client of a voxelpiped server. Uses the core's types: no gRPC and no protobuf in this header.
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
#include "wire/placed_stored.h"

namespace voxelpipe {

// TLS settings: the CA certificates that the client trusts, and its own. Files are PEM; an empty name means none.
struct ClientTls {
  std::string ca_file;              // trusted CA certificates; empty: those of the system
  std::string cert_file, key_file;  // the client's own certificate, if the server requires one
  std::string server_name;          // the name in the server's certificate, if it is not the target's host
};

struct ConnectOptions {
  std::optional<ClientTls> tls;             // absent: plain text
  std::string token;                        // sent with each call: `authorization: Bearer TOKEN`; empty: none
  std::chrono::milliseconds timeout{5000};  // for connecting
  uint64_t max_result_bytes = 64ull << 30;  // larger announced results are refused
  // How often Voxelize..., UploadMesh and Estimate... are repeated if the server refused them for a while (after the
  // time that it returned), became unavailable or lost the connection. Never beyond the job's deadline or after
  // Cancel(). Attempts to connect again to a server that restarts are not counted if the job has a deadline. With
  // retries = 0 there are no further attempts.
  int retries = 2;
  CallSettings settings;  // for the results of all calls
};

// How a server ran a job.
struct ServedBy {
  std::string worker;       // "cpu/0", "cuda:1/0"; empty where the server does not report it, or the result was cached
  double queue_ms = 0;      // from admission to the worker
  uint32_t batch_jobs = 0;  // jobs in the worker's batch, this one included
  std::optional<uint64_t> batch_launches;  // kernel launches of that batch; CUDA only
  uint32_t attempts = 0;                   // workers that tried the job; more than 1 if a device failed
};

// A server's report on a run, without its result.
struct RemoteRun {
  ServedBy served;
  VoxelizeStats stats;  // the server's figures, and its warnings
  // The server's "load" and "flatten", wall milliseconds; the stages of the pipeline are in stats.stages.
  std::vector<std::pair<std::string, double>> mesh_stages;
  MeshReport report;
  uint64_t peak_bytes = 0;  // the server's peak for this request
  bool cached = false;      // the result is from the cache, or shared with an equal request at the same time
  // SHA-256 of the result's bytes in stream order, 64 hexadecimal digits, checked on arrival; empty if
  // settings.content_hash is false.
  std::string content_sha256;
  uint64_t sent_bytes = 0;  // of the result as received, compressed or not
};

// The result of one mesh, in memory.
struct RemoteResult : RemoteRun {
  // The result of the core; `specs` are those of the request, `stats` the same as above.
  VoxelizeResult result;
};

// A mesh stored on the server.
struct StoredMesh {
  // "meshes/" and the SHA-256 of the file's bytes in hexadecimal digits; then "-mm" and so on where a unit was given,
  // "-obj" and so on where a format was given (MeshFileType).
  std::string name;
  MeshFormat format = MeshFormat::kAuto;  // of the file
  LengthUnit unit = LengthUnit::kNone;    // as it was given
  uint64_t file_bytes = 0;
  uint64_t memory_bytes = 0;    // its memory on the server
  MeshReport report;            // degenerate triangles and open edges are 0 until a job with a fill used the mesh
  WarningList warnings;         // including those of all its textures
  uint64_t uses = 0;            // number of jobs that used it
  bool already_stored = false;  // UploadMesh: the server already had it
};

struct ServerBackend {
  std::string name;  // "cpu", "cuda"
  std::string simd;  // instruction set of its row kernels
};

struct ServerDevice {
  std::string name;           // "cpu", "cuda:0"
  std::string backend;        // "cpu", "cuda"
  std::string model;          // the maker's name for it; empty if unknown
  uint64_t memory_bytes = 0;  // of the device
  uint32_t workers = 0;       // batches that run on it at the same time
  bool serving = true;
  std::string reason;  // why it does not serve
};

// A server's properties and limits.
struct ServerDescription {
  std::vector<ServerDevice> devices;
  std::string version;
  std::vector<ServerBackend> backends;  // best first
  uint32_t threads = 0;                 // of the CPU backend, shared by the running requests
  uint32_t workers = 0;                 // meshes that are loaded at the same time; see `devices` for running jobs
  uint32_t max_queue = 0;               // waiting requests
  uint64_t max_file_bytes = 0;
  uint64_t max_result_bytes = 0;
  uint64_t max_working_bytes = 0;
  uint64_t max_triangles = 0;
  uint64_t max_message_bytes = 0;     // of one request message; Voxelize sends smaller ones for meshes of any size
  uint64_t max_mesh_store_bytes = 0;  // memory of all stored meshes
  uint32_t batch_jobs = 0;            // outstanding jobs of one stream of OpenMany, beyond which the server waits
};

// True if an error says that no connection to the server was made, so that nothing was sent.
bool IsConnectError(const absl::Status& status);

class ManyStream;  // many_stream.h

// Thread-safe. Errors of all calls carry the server's code and message; a lost or refused connection is UNAVAILABLE
// naming the target.
class Client {
 public:
  // In: "HOST:PORT" or any gRPC target ("unix:/path"). UNAVAILABLE naming the target if no server answers or the TLS
  // handshake fails: at once if the connection is refused repeatedly, otherwise after `options.timeout`.
  // INVALID_ARGUMENT naming a file of `options.tls` that cannot be read.
  static absl::StatusOr<std::unique_ptr<Client>> Connect(const std::string& target, const ConnectOptions& options = {});
  ~Client();
  Client(const Client&) = delete;
  Client& operator=(const Client&) = delete;

  // In: the bytes of a self-contained mesh file (ReadAndPackMeshFile) and a request. `job`: Cancel() ends the call
  // within some ten milliseconds and the server's work with it; the deadline is sent with the call; Progress is called
  // with "upload", the server's stage names and "download", from one thread at a time. `on_plan`, if set, is called on
  // the calling thread before the result comes, once for each attempt (ConnectOptions::retries). Errors: the server's
  // (see Voxelize in pipeline/voxelize.h); CANCELLED, DEADLINE_EXCEEDED; DATA_LOSS if the result fails its checks
  // (offsets, lengths, CRC-32C of every piece, SHA-256 of the whole, sizes against the request; for sparse and bucketed
  // results also the consistency of the lists, see list_check.h).
  absl::StatusOr<RemoteResult> Voxelize(std::span<const uint8_t> mesh_bytes, MeshFileType type,
                                        const VoxelizeRequest& request, const JobContext& job,
                                        const std::function<void(const Plan&)>& on_plan = {});

  // The same for a result that need not fit into memory: `sink` receives it as it arrives, on the calling thread; the
  // lists of a sparse or bucketed result are kept in memory until all of them are there and agree. The sink's
  // errors end the call and are returned. The call is not repeated once the sink has received anything. The SHA-256 is
  // checked only after all bytes were written, so they are valid only if this returns OK (each piece has passed its
  // CRC-32C). Sink::Keep is not called.
  absl::StatusOr<RemoteRun> VoxelizeTo(std::span<const uint8_t> mesh_bytes, MeshFileType type,
                                       const VoxelizeRequest& request, const JobContext& job, ResultSink& sink,
                                       const std::function<void(const Plan&)>& on_plan = {});

  // Stores a mesh on the server, unless it already has it (the mesh's name is sent first). It stays until it is deleted
  // or evicted as least recently used. `job`: as in Voxelize; Progress is called with "upload". Errors: as in Voxelize
  // for a broken file; RESOURCE_EXHAUSTED if it is larger than the server's whole store; DATA_LOSS if the server
  // received other bytes.
  absl::StatusOr<StoredMesh> UploadMesh(std::span<const uint8_t> mesh_bytes, MeshFileType type, const JobContext& job);

  // Voxelize and VoxelizeTo with a stored mesh: the same bytes as with its file. NOT_FOUND if the server has none of
  // that name (any more): UploadMesh sends it again. `new_positions`, if not empty: x, y, z of every vertex of the
  // flattened mesh (report.vertices of them, in the order of the file's nodes and primitives), in world units,
  // replacing the mesh's own; everything else is kept, including normals. Skeletons and morph targets do not move such
  // a mesh. INVALID_ARGUMENT for another number, or naming the first vertex that is not finite.
  absl::StatusOr<RemoteResult> VoxelizeStored(const std::string& mesh_name, const VoxelizeRequest& request,
                                              const JobContext& job, std::span<const float> new_positions = {},
                                              const std::function<void(const Plan&)>& on_plan = {});
  absl::StatusOr<RemoteRun> VoxelizeStoredTo(const std::string& mesh_name, const VoxelizeRequest& request,
                                             const JobContext& job, ResultSink& sink,
                                             std::span<const float> new_positions = {},
                                             const std::function<void(const Plan&)>& on_plan = {});

  // Voxelize and VoxelizeTo with several stored meshes on one grid: the same bytes as PlaceMeshes (mesh/placed_mesh.h)
  // and Voxelize in this process. A part that moves is the same list with another matrix. NOT_FOUND names all meshes
  // that the server does not have, at most 100 of them; INVALID_ARGUMENT the field of the list that is wrong.
  absl::StatusOr<RemoteResult> VoxelizePlaced(std::span<const PlacedStored> meshes, const VoxelizeRequest& request,
                                              const JobContext& job,
                                              const std::function<void(const Plan&)>& on_plan = {});
  absl::StatusOr<RemoteRun> VoxelizePlacedTo(std::span<const PlacedStored> meshes, const VoxelizeRequest& request,
                                             const JobContext& job, ResultSink& sink,
                                             const std::function<void(const Plan&)>& on_plan = {});

  // The server's description of a stored mesh. NOT_FOUND if it does not have it.
  absl::StatusOr<StoredMesh> GetMesh(const std::string& mesh_name);
  // The meshes on which this client has a claim, an administrator's call all of them; the newest first.
  absl::StatusOr<std::vector<StoredMesh>> ListMeshes();
  // Releases this client's claim on a mesh, and deletes the mesh if no other client has a claim; jobs that use it
  // continue. Out: the freed bytes, 0 if it stays for others. NOT_FOUND if the server does not have it,
  // PERMISSION_DENIED without a claim.
  absl::StatusOr<uint64_t> ReleaseMesh(const std::string& mesh_name);
  // Deletes a mesh whatever claims it has; jobs that use it continue. Out: the freed bytes. NOT_FOUND if the server
  // does not have it, PERMISSION_DENIED for all but administrators.
  absl::StatusOr<uint64_t> DeleteMesh(const std::string& mesh_name);

  // Opens a stream for many small jobs (many_stream.h). At most `window` of them are outstanding at a time. `job`:
  // Cancel() ends the stream, its deadline is the stream's; it must outlive the stream, as must this client.
  std::unique_ptr<ManyStream> OpenMany(const JobContext& job, size_t window = 64);

  struct Estimated {
    Plan plan;
    MeshReport report;  // the server's report on the mesh
  };
  // The plan of a request, without running it. Sends the whole mesh in one message: for files below the server's
  // max_message_bytes.
  absl::StatusOr<Estimated> Estimate(std::span<const uint8_t> mesh_bytes, MeshFileType type,
                                     const VoxelizeRequest& request, const JobContext& job);
  // The same for a mesh given by its size and the box of its vertices after the vertex shader.
  absl::StatusOr<Plan> Estimate(uint64_t triangles, uint64_t vertices, const Box3d& shaded_box,
                                const VoxelizeRequest& request, const JobContext& job);

  // The same for a stored mesh, and for several on one grid.
  absl::StatusOr<Estimated> EstimateStored(const std::string& mesh_name, const VoxelizeRequest& request,
                                           const JobContext& job);
  absl::StatusOr<Estimated> EstimatePlaced(std::span<const PlacedStored> meshes, const VoxelizeRequest& request,
                                           const JobContext& job);

  // The server's shaders, vertex shaders first.
  absl::StatusOr<std::vector<ShaderInfo>> ListShaders();

  absl::StatusOr<ServerDescription> ServerInfo();

  // OK while the server accepts requests; UNAVAILABLE if it is draining or cannot be reached.
  absl::Status CheckHealth(std::chrono::milliseconds timeout = std::chrono::seconds(3));

  const std::string& target() const;

 private:
  struct Impl;
  explicit Client(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace voxelpipe
