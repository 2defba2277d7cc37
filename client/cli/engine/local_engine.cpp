// The core in this process.
#include <algorithm>
#include <memory>

#include "engine/clock.h"
#include "engine/engine.h"
#include "mesh/parts/part_list.h"
#include "mesh/placed_mesh.h"
#include "mesh/report.h"

namespace voxelpipe::cli {

namespace {

// The mesh of a run, and what it took to make it.
struct RunMesh {
  TriangleMesh mesh;
  std::vector<std::pair<std::string, double>> stages;  // milliseconds
};

absl::StatusOr<RunMesh> LoadAll(MeshInputs inputs, const TextureUse& use, const JobContext& job) {
  double load_ms = 0, flatten_ms = 0;
  std::vector<std::shared_ptr<TriangleMesh>> meshes;
  for (MeshInput& input : inputs.files) {
    absl::StatusOr<LoadedMesh> loaded = LoadMeshInput(std::move(input), use, job);
    if (!loaded.ok()) return loaded.status();
    load_ms += loaded->load_ms;
    flatten_ms += loaded->flatten_ms;
    meshes.push_back(std::make_shared<TriangleMesh>(std::move(loaded->mesh)));
  }
  RunMesh made{{}, {{"load", load_ms}, {"flatten", flatten_ms}}};
  if (inputs.placed.empty()) {
    made.mesh = std::move(*meshes[0]);
    return made;
  }
  const Stopwatch clock;
  std::vector<PlacedMesh> placed;
  placed.reserve(inputs.placed.size());
  for (PlacedInput& input : inputs.placed) {
    placed.push_back(std::move(input.placement));
    placed.back().mesh = meshes[input.file];
  }
  absl::StatusOr<TriangleMesh> together = PlaceMeshes(job, placed);
  if (!together.ok()) return together.status();
  made.mesh = *std::move(together);
  made.stages.emplace_back("place", clock.Milliseconds());
  return made;
}

absl::StatusOr<RunMesh> Load(MeshInputs inputs, const VoxelizeRequest& request, const JobContext& job) {
  absl::StatusOr<RunMesh> made = LoadAll(std::move(inputs), TexturesRead(request), job);
  if (!made.ok() || request.parts.exclude.empty()) return made;
  absl::StatusOr<TriangleMesh> kept = ExcludeParts(job, made->mesh, request.parts);
  if (!kept.ok()) return kept.status();
  made->mesh = *std::move(kept);
  return made;
}

class LocalEngine : public Engine {
 public:
  absl::StatusOr<EngineRun> Run(MeshInputs meshes, const VoxelizeRequest& request, int repeat, JobContext& job,
                                ResultSink& sink, VoxelizeResult* whole) override {
    absl::StatusOr<RunMesh> loaded = Load(std::move(meshes), request, job);
    if (!loaded.ok()) return loaded.status();
    const PlanLimits limits = LimitsInProcess(job);
    EngineRun run;
    run.mesh_stages = std::move(loaded->stages);
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
