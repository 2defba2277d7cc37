#include "runs.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <memory>
#include <new>
#include <optional>

#include "absl/strings/str_cat.h"
#include "load/decode/image.h"
#include "pipeline/batch.h"
#include "pipeline/estimate.h"
#include "pipeline/stages/backend.h"
#include "pipeline/voxelize.h"
#include "pipeline/warnings.h"
#include "wire/mesh_contents.h"
#include "wire/response.h"

namespace voxelpipe {
namespace {

// What `work` returns, or RESOURCE_EXHAUSTED if the memory does not suffice.
template <typename Work>
auto WithoutBadAlloc(const Work& work) -> decltype(work()) {
  try {
    return work();
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory");
  }
}

Outcome OutcomeOf(VoxelizeResult result, const UsedMesh& used) {
  return {std::move(result), used.report(), used.examined(), used.stages(), used.peak_bytes()};
}

absl::StatusOr<Outcome> RunOn(const ParsedConfig& config, const UsedMesh& used, const JobContext& job, bool on_device) {
  absl::StatusOr<VoxelizeResult> result =
      Voxelize(used.mesh(), config.request, {.job = job, .limits = LimitsInProcess(job), .on_device = on_device});
  if (!result.ok()) return result.status();
  if (on_device && result->device_targets.empty()) {
    return absl::FailedPreconditionError(absl::StrCat(
        "on the device: the grid ", result->grid.dims[0], "x", result->grid.dims[1], "x", result->grid.dims[2],
        " was made in several slabs, so that the result is in this machine's memory"));
  }
  return OutcomeOf(*std::move(result), used);
}

// True for errors that another device would give too.
bool IsOfTheRequest(const absl::Status& status) {
  return absl::IsInvalidArgument(status) || absl::IsCancelled(status) || absl::IsDeadlineExceeded(status);
}

}  // namespace

std::vector<absl::StatusOr<std::shared_ptr<HeldMesh>>> LoadAll(std::span<const NamedFile> files,
                                                               std::span<JobContext* const> jobs) {
  std::vector<absl::StatusOr<std::shared_ptr<HeldMesh>>> meshes(files.size());
  tbb::parallel_for(size_t{0}, files.size(), [&](size_t i) {
    meshes[i] = WithoutBadAlloc([&] { return HeldMesh::Load(files[i].file, files[i].type, files[i].name, *jobs[i]); });
  });
  return meshes;
}

absl::StatusOr<Outcome> RunOne(const ParsedConfig& config, const MeshSource& source, const JobContext& job,
                               bool on_device) {
  if (on_device && config.request.result != ResultKind::kDense) {
    return absl::FailedPreconditionError(absl::StrCat("on the device: only dense results stay on a GPU, not ",
                                                      std::string(Name(config.request.result))));
  }
  return WithoutBadAlloc([&]() -> absl::StatusOr<Outcome> {
    const absl::StatusOr<std::unique_ptr<UsedMesh>> used = UsedMesh::Open(source, config, job);
    return used.ok() ? RunOn(config, **used, job, on_device) : used.status();
  });
}

std::vector<absl::StatusOr<Outcome>> RunMany(const ParsedConfig& config, std::span<const MeshSource> sources,
                                             std::span<JobContext* const> jobs) {
  const size_t count = sources.size();
  std::vector<absl::StatusOr<Outcome>> outcomes(count);
  std::vector<std::unique_ptr<UsedMesh>> used(count);
  tbb::parallel_for(size_t{0}, count, [&](size_t i) {
    // Isolated: a thread that waits within one mesh must not begin another, whose lock it may have.
    auto opened = tbb::this_task_arena::isolate(
        [&] { return WithoutBadAlloc([&] { return UsedMesh::Open(sources[i], config, *jobs[i]); }); });
    if (opened.ok()) {
      used[i] = *std::move(opened);
    } else {
      outcomes[i] = opened.status();
    }
  });
  const absl::StatusOr<const Backend*> backend = SelectBackend(config.request.backend);
  std::vector<BatchItem> items;
  for (size_t i = 0; i < count; ++i) {
    if (used[i] == nullptr) continue;
    if (!backend.ok()) {
      outcomes[i] = backend.status();
      continue;
    }
    items.push_back({&used[i]->mesh(), &config.request, jobs[i], {}, [&, i](absl::StatusOr<VoxelizeResult> result) {
                       outcomes[i] = result.ok() ? absl::StatusOr<Outcome>(OutcomeOf(*std::move(result), *used[i]))
                                                 : absl::StatusOr<Outcome>(result.status());
                     }});
  }
  if (items.empty()) return outcomes;
  VoxelizeBatch(**backend, items, config.request.threads, LimitsInProcess(*jobs[0]));
  if (config.request.backend != BackendChoice::kAuto || (*backend)->name() == "cpu") return outcomes;
  for (size_t i = 0; i < count; ++i) {  // where the GPU failed, or has no room
    if (used[i] == nullptr || outcomes[i].ok() || IsOfTheRequest(outcomes[i].status())) continue;
    outcomes[i] = WithoutBadAlloc([&] { return RunOn(config, *used[i], *jobs[i], false); });
  }
  return outcomes;
}

absl::StatusOr<v1::EstimateVoxelizationResponse> EstimateOne(const ParsedConfig& config, const MeshSource& source,
                                                             const JobContext& job) {
  return WithoutBadAlloc([&]() -> absl::StatusOr<v1::EstimateVoxelizationResponse> {
    const absl::StatusOr<std::unique_ptr<UsedMesh>> used = UsedMesh::Open(source, config, job);
    if (!used.ok()) return used.status();
    const TriangleMesh& mesh = (*used)->mesh();
    const absl::StatusOr<Plan> plan =
        EstimateVoxelization(mesh, config.request, job, LimitsInProcess(job), Delivery::kMemory);
    if (!plan.ok()) return plan.status();
    v1::EstimateVoxelizationResponse response;
    WriteTo(*plan, *response.mutable_plan());
    WriteTo((*used)->report(), (*used)->examined(), *response.mutable_report());
    if (!source.held && !config.placed) CheckImages(mesh);  // others read those of held ones
    WriteWarnings(AllWarningsOf(mesh), response);
    return response;
  });
}

}  // namespace voxelpipe
