// Where the CLI's work is done: in this process, or on a server.
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
#include "load/pack.h"
#include "pipeline/voxelize.h"
#include "shaders/catalog.h"

namespace voxelpipe::cli {

// What one mesh gave, besides the bytes that went to the sink.
struct EngineRun {
  std::vector<std::pair<std::string, double>> mesh_stages;  // load and flatten, milliseconds
  std::vector<VoxelizeStats> runs;                          // of every run, in order; at least one
  std::optional<uint64_t> open_edges;                       // with a fill
  // How a server ran the last of them; absent in-process.
  struct Served {
    std::string worker;       // empty where the server does not say
    double queue_ms = 0;      // from admission to the worker
    uint32_t batch_jobs = 0;  // jobs of the worker's pass
    uint32_t attempts = 0;    // workers that were given the job
    bool cached = false;      // the result was made for an equal request
    uint64_t sent_bytes = 0;  // of the result as they came, compressed or not
  };
  std::optional<Served> served;
  WarningList warnings;                       // of packing the file, and of the last run
  std::optional<uint64_t> server_peak_bytes;  // the server's peak for the request; absent in-process
};

// A self-contained mesh file in memory, sibling files packed in.
struct MeshInput {
  FileBytes bytes;
  double read_ms = 0;
  WarningList warnings{};  // what packing had to pass over
};

// Errors: those of ReadAndPackMeshFile.
absl::StatusOr<MeshInput> ReadMeshInput(const std::string& path, const OutsideFiles& outside, const JobContext& job);

class Engine {
 public:
  virtual ~Engine() = default;

  // Voxelizes the mesh `repeat` times (at least once), and hands the result of the last run to `sink`: all runs give
  // the same bytes. A single dense run needs memory for a part of its result only, unless it is to be kept whole in
  // `whole`.
  virtual absl::StatusOr<EngineRun> Run(MeshInput mesh, const VoxelizeRequest& request, int repeat, JobContext& job,
                                        ResultSink& sink, VoxelizeResult* whole = nullptr) = 0;
  virtual absl::StatusOr<std::vector<ShaderInfo>> Shaders() = 0;
};

std::unique_ptr<Engine> MakeLocalEngine();

}  // namespace voxelpipe::cli
