// The core in this process.
#include <algorithm>

#include "engine/clock.h"
#include "engine/engine.h"
#include "engine/mesh_file.h"
#include "load/decode/image.h"
#include "load/load_job.h"
#include "mesh/flatten_job.h"
#include "mesh/report.h"

namespace voxelpipe::cli {

absl::StatusOr<LoadedMesh> LoadMesh(MeshInput mesh, const JobContext& job) {
  LoadedMesh loaded;
  const Stopwatch load;
  loaded.packed_bytes = mesh.bytes.size();
  absl::StatusOr<Scene> scene = LoadSceneFor(job, mesh.bytes);
  if (!scene.ok()) return scene.status();
  loaded.scene = *std::move(scene);
  loaded.load_ms = mesh.read_ms + load.Milliseconds();
  mesh.bytes = FileBytes();  // the scene owns its data
  if (absl::Status status = job.Check(); !status.ok()) return status;

  const Stopwatch flatten;
  job.Report("flatten", 0);
  absl::StatusOr<TriangleMesh> flat = FlattenFor(job, loaded.scene, LoadLimits());
  if (!flat.ok()) return flat.status();
  loaded.mesh = *std::move(flat);
  loaded.flatten_ms = flatten.Milliseconds();
  if (absl::Status status = job.Check(); !status.ok()) return status;
  return loaded;
}

namespace {

class LocalEngine : public Engine {
 public:
  absl::StatusOr<EngineRun> Run(MeshInput mesh, const VoxelizeRequest& request, int repeat, JobContext& job,
                                ResultSink& sink, VoxelizeResult* whole) override {
    absl::StatusOr<LoadedMesh> loaded = LoadMesh(std::move(mesh), job);
    if (!loaded.ok()) return loaded.status();
    loaded->scene = Scene();  // only the flattened mesh is needed from here on
    if (RequestReadsTextures(request)) {
      const Stopwatch decode;
      if (absl::Status status = PrepareTexturesFor(job, loaded->mesh, LoadLimits{}, TexturesRead(request));
          !status.ok()) {
        return status;
      }
      loaded->load_ms += decode.Milliseconds();
    }
    PlanLimits limits;  // less the memory of the mesh
    const MemoryBudget& memory = MemoryOf(job);
    limits.max_working_bytes =
        std::min(limits.max_working_bytes, memory.limit_bytes() - std::min(memory.limit_bytes(), memory.used_bytes()));
    EngineRun run;
    run.mesh_stages = {{"load", loaded->load_ms}, {"flatten", loaded->flatten_ms}};
    if (repeat == 1 && whole == nullptr) {
      absl::StatusOr<VoxelizeStats> stats = VoxelizeTo(loaded->mesh, request, {job, limits}, sink);
      if (!stats.ok()) return stats.status();
      run.runs.push_back(*std::move(stats));
    } else {
      VoxelizeResult last;
      for (int i = 0; i < repeat; ++i) {
        last = VoxelizeResult();  // freed before the next run: one result in memory at a time
        absl::StatusOr<VoxelizeResult> result = Voxelize(loaded->mesh, request, {job, limits});
        if (!result.ok()) return result.status();
        last = *std::move(result);
        run.runs.push_back(last.stats);
      }
      if (absl::Status status = WriteTo(last, sink); !status.ok()) return status;
      if (whole != nullptr) *whole = std::move(last);
    }
    if (request.fill != Fill::kNone) run.open_edges = CountOpenEdges(loaded->mesh);
    return run;
  }

  absl::StatusOr<std::vector<ShaderInfo>> Shaders() override {
    const std::span<const ShaderInfo> all = ListShaders();
    return std::vector<ShaderInfo>(all.begin(), all.end());
  }
};

}  // namespace

std::unique_ptr<Engine> MakeLocalEngine() {
  return std::make_unique<LocalEngine>();
}

}  // namespace voxelpipe::cli
