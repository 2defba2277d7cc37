#include "jobs/voxelize_job.h"

#include <algorithm>
#include <new>
#include <utility>

#include "jobs/prepare_kept.h"
#include "mesh/mesh_bytes.h"
#include "schedule/cost.h"
#include "shaders/catalog.h"

namespace voxelpipe {
namespace {

constexpr double kBeyondLimitsMs = 10'000;

}  // namespace

uint64_t VoxelizeJob::file_bytes() const {
  uint64_t bytes = 0;
  for (const std::string& piece : pieces) bytes += piece.size();
  return bytes;
}

bool VoxelizeJob::has_textures() const {
  if (!RequestReadsTextures(config.request)) return true;
  const TextureUse use = TexturesRead(config.request);
  return std::all_of(kept.begin(), kept.end(), [&](const auto& one) { return one->ready(use); });
}

bool VoxelizeJob::loaded() const {
  if (ready) return false;
  if (mesh) return true;
  if (file_bytes() > kLoadedByWorker || (makes_of_kept() && traits.cost.load_ms > kMadeByWorkerMs)) return false;
  if (!kept.empty()) return has_textures();
  return !costly_.compressed && !costly_.instanced && !(costly_.images && RequestReadsTextures(config.request));
}

absl::Status VoxelizeJob::Prepare() {
  if (mesh) return context.Check();
  absl::StatusOr<std::shared_ptr<const PreparedMesh>> prepared = absl::ResourceExhaustedError("out of memory");
  try {
    std::vector<uint8_t> file;
    file.reserve(file_bytes());
    for (; !pieces.empty(); pieces.pop_front()) file.insert(file.end(), pieces.front().begin(), pieces.front().end());
    prepared = kept.empty() ? PrepareMesh(std::move(file), config, *limits, context)
                            : PrepareKept(*store, kept, file, config, *limits, context);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory for the mesh file");
  }
  if (!prepared.ok()) return prepared.status();
  // Its budget lives as long as it does.
  const PreparedMesh* const made = prepared->get();
  mesh = std::shared_ptr<const PreparedMesh>(
      made, [owner = *std::move(prepared), budget = memory](const PreparedMesh*) mutable { owner.reset(); });
  return absl::OkStatus();
}

void VoxelizeJob::FreeMesh() {
  mesh.reset();
  kept.clear();
  config.placed.reset();
}

void VoxelizeJob::Weigh() {
  MeshFacts facts;
  facts.format = config.mesh_type.format;
  if (mesh) {
    facts.triangles = mesh->mesh->triangles.size();
    facts.box = Box3d{mesh->report.min, mesh->report.max, mesh->report.triangles == 0};
    if (kept.empty()) facts.memory_bytes = MeshBytes(*mesh->mesh);  // the store accounts for a stored mesh
    if (makes_of_kept()) facts.memory_bytes = mesh->peak_bytes;     // and for the images of placed ones
  } else {
    facts.file_bytes = file_bytes();
    if (kept.empty() && !pieces.empty()) {
      const std::string& first = pieces.front();
      costly_ =
          FindCostlyParts({reinterpret_cast<const uint8_t*>(first.data()), first.size()}, config.mesh_type.format);
      facts.compressed = costly_.compressed;
    }
    if (!kept.empty()) facts.triangles = TrianglesOf(kept);
  }
  traits.cost = PredictCost(config.request, facts);
  if (!kept.empty()) traits.cost.load_ms = 0;
  if (makes_of_kept() && !mesh) traits.cost.load_ms = PredictPlaceMs(kept.size(), *facts.triangles);
  if (exported) traits.cost.run_ms += PredictExportMs(traits.cost);
  // Beyond the limits it is refused as soon as its grid is known. Until then it counts as a giant, but not as more work
  // than all others together, so that it gets the error of the limit and not that of a long queue.
  if (limits != nullptr && (traits.cost.output_bytes > limits->plan.max_result_bytes ||
                            traits.cost.triangles > limits->load.max_triangles)) {
    traits.cost.run_ms = std::min(traits.cost.run_ms, kBeyondLimitsMs);
  }
}

bool VoxelizeJob::Load() {
  if (ready) {
    DoneShared(ready, ready_plan, true);
    return false;
  }
  if (absl::Status s = Prepare(); !s.ok()) {
    Done(std::move(s));
    return false;
  }
  return true;
}

}  // namespace voxelpipe
