// The core in this process.
#include <algorithm>

#include "engine/engine.h"
#include "mesh/report.h"

namespace voxelpipe::cli {

namespace {

class LocalEngine : public Engine {
 public:
  absl::StatusOr<EngineRun> Run(MeshInput mesh, const VoxelizeRequest& request, int repeat, JobContext& job,
                                ResultSink& sink, VoxelizeResult* whole) override {
    absl::StatusOr<LoadedMesh> loaded = LoadMeshInput(std::move(mesh), TexturesRead(request), job);
    if (!loaded.ok()) return loaded.status();
    const PlanLimits limits = LimitsInProcess(job);
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
    if (request.fill != Fill::kNone) {
      const absl::StatusOr<uint64_t> open_edges = CountOpenEdges(job, loaded->mesh);
      if (!open_edges.ok()) return open_edges.status();
      run.open_edges = *open_edges;
    }
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
