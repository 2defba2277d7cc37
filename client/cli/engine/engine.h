// The engine that runs the CLI's jobs: in this process, or on a server.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "load/file_bytes.h"
#include "load/load_mesh.h"
#include "load/pack.h"
#include "options/together.h"
#include "pipeline/voxelize.h"
#include "shaders/catalog.h"

namespace voxelpipe::cli {

// The outcome of one mesh, besides the bytes that went to the sink.
struct EngineRun {
  std::vector<std::pair<std::string, double>> mesh_stages;  // load and flatten, milliseconds
  std::vector<VoxelizeStats> runs;                          // of every run, in order; at least one
  std::optional<uint64_t> open_edges;                       // with a fill
  // Execution of the last run on a server; absent in-process.
  struct Served {
    std::string worker;       // empty if the server did not report it
    double queue_ms = 0;      // from admission to the worker
    uint32_t batch_jobs = 0;  // jobs of the worker's batch
    uint32_t attempts = 0;    // workers that tried the job
    bool cached = false;      // the result is that of an equal request
    uint64_t sent_bytes = 0;  // of the result as received, compressed or not
  };
  std::optional<Served> served;
  WarningList warnings;                       // of packing the file, and of the last run
  std::optional<uint64_t> server_peak_bytes;  // the server's peak for the request; absent in-process
};

// A self-contained mesh file in memory, sibling files packed in.
struct MeshInput {
  FileBytes bytes;
  double read_ms = 0;
  WarningList warnings{};  // of packing
  MeshFileType type{};     // its format kAuto if the content shows it
};

// The meshes of one run.
struct MeshInputs {
  std::vector<MeshInput> files;     // each once; at least one
  std::vector<PlacedInput> placed;  // of `files`; empty: files[0], as it is
};

// How the file of a mesh is to be read.
struct MeshReading {
  OutsideFiles outside{};
  MeshFileType type{};
};

// In: the path of a mesh file, or "-" for standard input; files that such a mesh names are searched in the working
// directory. A format that neither the caller nor the content says is that of the path's extension. Errors: those of
// ReadLocalFile, ReadStandardInput and PackMesh, without the path.
absl::StatusOr<MeshInput> ReadMeshInput(const std::string& path, const MeshReading& reading, const JobContext& job);

// LoadMeshFor (load/load_mesh.h) in this process, with the textures in `use`; to read the file is part of load_ms.
absl::StatusOr<LoadedMesh> LoadMeshInput(MeshInput mesh, const TextureUse& use, const JobContext& job);

class Engine {
 public:
  virtual ~Engine() = default;

  // Voxelizes the meshes `repeat` times (at least once), and writes the result of the last run to `sink`; all runs give
  // the same bytes. A single dense run needs memory for a part of its result only, unless `whole` receives all of it.
  virtual absl::StatusOr<EngineRun> Run(MeshInputs meshes, const VoxelizeRequest& request, int repeat, JobContext& job,
                                        ResultSink& sink, VoxelizeResult* whole = nullptr) = 0;
  virtual absl::StatusOr<std::vector<ShaderInfo>> Shaders() = 0;
};

std::unique_ptr<Engine> MakeLocalEngine();

}  // namespace voxelpipe::cli
