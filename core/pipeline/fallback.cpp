// The public functions of voxelize.h: on which device a request runs, and what does it where that device fails.
#include <memory>
#include <new>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/device_failure.h"
#include "job/resuming_sink.h"
#include "pipeline/assemble.h"
#include "pipeline/run.h"
#include "pipeline/stages/backend.h"
#include "pipeline/warnings.h"

namespace voxelpipe {
namespace {

// RunPipeline with the warnings that its counts give, and with what a run may throw as a status.
absl::Status RunInside(const RunInput& run, Assembler& assembler, VoxelizeStats& stats) {
  try {
    if (absl::Status s = RunPipeline(run, assembler, stats); !s.ok()) return s;
    AddRunWarnings(run.mesh, run.request, stats);
    return CheckStrict(run.request, stats.warnings);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory while voxelizing");
  }
}

}  // namespace

absl::StatusOr<VoxelizeResult> VoxelizeInside(const Backend& backend, const TriangleMesh& mesh,
                                              const VoxelizeRequest& request, const JobContext& job,
                                              const PlanLimits& limits, const PlanHook& on_plan) {
  MemoryAssembler assembler;
  VoxelizeStats stats;
  const RunInput run{backend, mesh, request, job, limits, Delivery::kMemory, on_plan};
  const absl::Status s = RunInside(run, assembler, stats);
  if (!s.ok()) return s;
  VoxelizeResult result = assembler.Take();
  result.stats = std::move(stats);
  return result;
}

absl::StatusOr<VoxelizeResult> VoxelizeOn(const Backend& backend, const TriangleMesh& mesh,
                                          const VoxelizeRequest& request, const JobContext& job,
                                          const PlanLimits& limits, const PlanHook& on_plan) {
  absl::StatusOr<VoxelizeResult> result = absl::UnknownError("the run did not start");
  backend.Run(request.threads, [&] { result = VoxelizeInside(backend, mesh, request, job, limits, on_plan); });
  return result;
}

absl::StatusOr<VoxelizeStats> VoxelizeOnTo(const Backend& backend, const TriangleMesh& mesh,
                                           const VoxelizeRequest& request, const JobContext& job,
                                           const PlanLimits& limits, ResultSink& sink, const PlanHook& on_plan) {
  VoxelizeStats stats;
  if (request.result == ResultKind::kDense) {
    StreamAssembler assembler(sink);
    const RunInput run{backend, mesh, request, job, limits, Delivery::kStream, on_plan};
    absl::Status s = absl::UnknownError("the run did not start");
    backend.Run(request.threads, [&] { s = RunInside(run, assembler, stats); });
    if (!s.ok()) return s;
    return stats;
  }
  absl::StatusOr<VoxelizeResult> result = VoxelizeOn(backend, mesh, request, job, limits, on_plan);
  if (!result.ok()) return result.status();
  stats = std::move(result->stats);
  if (sink.Keep(*std::move(result))) return stats;
  if (absl::Status s = WriteTo(*result, sink); !s.ok()) return s;  // NOLINT(bugprone-use-after-move): it was not kept
  return stats;
}

namespace {

// Tells of the first plan alone.
PlanHook TellOnce(const std::function<void(const Plan&)>& on_plan) {
  if (!on_plan) return {};
  return [&on_plan, told = std::make_shared<bool>(false)](const Plan& plan) {
    if (!std::exchange(*told, true)) on_plan(plan);
    return absl::OkStatus();
  };
}

// Where any device may run a request and this one failed by no fault of the request's: the one that runs it instead, or
// null.
const Backend* InsteadOf(const Backend& backend, BackendChoice choice, const absl::Status& status) {
  if (choice != BackendChoice::kAuto || status.ok() || !DeviceFailureOf(status)) return nullptr;
  const absl::StatusOr<const Backend*> cpu = SelectBackend(BackendChoice::kCpu);
  return cpu.ok() && *cpu != &backend ? *cpu : nullptr;
}

std::string Words(const Backend& backend, const absl::Status& failure) {
  return absl::StrCat(backend.device(), ": ", failure.message());
}

VoxelizeStats& StatsOf(VoxelizeResult& result) {
  return result.stats;
}
VoxelizeStats& StatsOf(VoxelizeStats& stats) {
  return stats;
}

// Calls run(backend, whether another one was tried before) on the backend that the request chooses, and then, where that
// may help, on the one that runs it instead.
template <typename Run>
auto RunOnChosen(const VoxelizeRequest& request, Run&& run) -> decltype(run(std::declval<const Backend&>(), false)) {
  // Said first of all that is wrong with a request, whatever this machine has.
  if (absl::Status s = ValidateRequest(request); !s.ok()) return s;
  const absl::StatusOr<const Backend*> backend = SelectBackend(request.backend);
  if (!backend.ok()) return backend.status();
  auto result = run(**backend, false);
  const Backend* const other = InsteadOf(**backend, request.backend, result.status());
  if (other == nullptr) return result;
  const std::string failure = Words(**backend, result.status());
  result = run(*other, true);
  if (result.ok()) {
    StatsOf(*result).device_failure = failure;
    return result;
  }
  const absl::Status& status = result.status();
  return absl::Status(status.code(), absl::StrCat(status.message(), "; tried before, ", failure));
}

}  // namespace

absl::StatusOr<VoxelizeResult> Voxelize(const TriangleMesh& mesh, const VoxelizeRequest& request, const JobContext& job,
                                        const PlanLimits& limits, const std::function<void(const Plan&)>& on_plan) {
  const PlanHook tell = TellOnce(on_plan);
  return RunOnChosen(
      request, [&](const Backend& backend, bool) { return VoxelizeOn(backend, mesh, request, job, limits, tell); });
}

absl::StatusOr<VoxelizeStats> VoxelizeTo(const TriangleMesh& mesh, const VoxelizeRequest& request,
                                         const JobContext& job, const PlanLimits& limits, ResultSink& sink,
                                         const std::function<void(const Plan&)>& on_plan) {
  const PlanHook tell = TellOnce(on_plan);
  ResumingSink resuming(sink);
  return RunOnChosen(request, [&](const Backend& backend, bool again) {
    if (again) resuming.Restart();
    return VoxelizeOnTo(backend, mesh, request, job, limits, resuming, tell);
  });
}

}  // namespace voxelpipe
