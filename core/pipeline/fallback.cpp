// The public functions of voxelize.h: the device on which a request runs, and the one that takes over where it fails.
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

// RunPipeline in the backend's arena, with the warnings that its counts give, and with what a run may throw as a
// status.
absl::Status RunGuarded(const RunInput& run, bool inside, Assembler& assembler, VoxelizeStats& stats) {
  absl::Status status = absl::UnknownError("the run did not start");
  const auto body = [&] {
    try {
      status = RunPipeline(run, assembler, stats);
      if (!status.ok()) return;
      AddRunWarnings(run.job, run.mesh, run.request, stats);
      status = CheckStrict(run.request, stats.warnings);
    } catch (const std::bad_alloc&) {
      status = absl::ResourceExhaustedError("out of memory while voxelizing");
    }
  };
  if (inside) {
    body();
  } else {
    run.backend.Run(run.request.threads, body);
  }
  return status;
}

absl::StatusOr<VoxelizeResult> RunToMemory(const Backend& backend, const TriangleMesh& mesh,
                                           const VoxelizeRequest& request, const RunOptions& options) {
  MemoryAssembler assembler;
  VoxelizeStats stats;
  const RunInput run{backend,          mesh, request, options.job, options.limits, Delivery::kMemory, options.on_plan,
                     options.on_device};
  if (absl::Status s = RunGuarded(run, options.inside, assembler, stats); !s.ok()) return s;
  VoxelizeResult result = assembler.Take();
  result.stats = std::move(stats);
  return result;
}

absl::StatusOr<VoxelizeStats> RunToSink(const Backend& backend, const TriangleMesh& mesh,
                                        const VoxelizeRequest& request, const RunOptions& options, ResultSink& sink) {
  VoxelizeStats stats;
  if (request.result == ResultKind::kDense) {
    StreamAssembler assembler(sink);
    const RunInput run{backend, mesh, request, options.job, options.limits, Delivery::kStream, options.on_plan};
    if (absl::Status s = RunGuarded(run, options.inside, assembler, stats); !s.ok()) return s;
    return stats;
  }
  absl::StatusOr<VoxelizeResult> result = RunToMemory(backend, mesh, request, options);
  if (!result.ok()) return result.status();
  stats = std::move(result->stats);
  if (sink.Keep(*std::move(result))) return stats;
  if (absl::Status s = WriteTo(*result, sink); !s.ok()) return s;  // NOLINT(bugprone-use-after-move): it was not kept
  return stats;
}

// The device that runs a request in place of `backend`, which failed by no fault of the request; null if there is none.
const Backend* InsteadOf(const Backend& backend, BackendChoice choice, const absl::Status& status) {
  if (choice != BackendChoice::kAuto || status.ok() || !DeviceFailureOf(status)) return nullptr;
  const absl::StatusOr<const Backend*> cpu = SelectBackend(BackendChoice::kCpu);
  return cpu.ok() && *cpu != &backend ? *cpu : nullptr;
}

VoxelizeStats& StatsOf(VoxelizeResult& result) {
  return result.stats;
}
VoxelizeStats& StatsOf(VoxelizeStats& stats) {
  return stats;
}

// Calls run(backend, options) on the backend that the request chooses and, where that may help, on the one that takes
// over. The caller's hook gets the first plan only.
template <typename Run>
auto RunOnChosen(const VoxelizeRequest& request, const RunOptions& options, const Run& run)
    -> decltype(run(std::declval<const Backend&>(), options)) {
  // Said first of all that is wrong with a request, whatever this machine has.
  if (absl::Status s = ValidateRequest(request); !s.ok()) return s;
  const absl::StatusOr<const Backend*> backend = SelectBackend(request.backend);
  if (!backend.ok()) return backend.status();
  bool planned = false;
  RunOptions once{.job = options.job, .limits = options.limits, .on_device = options.on_device};
  if (options.on_plan) {
    once.on_plan = [&](const Plan& plan) {
      return std::exchange(planned, true) ? absl::OkStatus() : options.on_plan(plan);
    };
  }
  auto result = run(**backend, once);
  const Backend* const other = InsteadOf(**backend, request.backend, result.status());
  if (other == nullptr) return result;
  const std::string failure = absl::StrCat((*backend)->device(), ": ", result.status().message());
  result = run(*other, once);
  if (result.ok()) {
    StatsOf(*result).device_failure = failure;
    return result;
  }
  const absl::Status& status = result.status();
  return absl::Status(status.code(), absl::StrCat(status.message(), "; tried before, ", failure));
}

}  // namespace

absl::StatusOr<VoxelizeResult> Voxelize(const TriangleMesh& mesh, const VoxelizeRequest& request,
                                        const RunOptions& options) {
  if (options.backend != nullptr) return RunToMemory(*options.backend, mesh, request, options);
  return RunOnChosen(request, options, [&](const Backend& backend, const RunOptions& once) {
    return RunToMemory(backend, mesh, request, once);
  });
}

absl::StatusOr<VoxelizeStats> VoxelizeTo(const TriangleMesh& mesh, const VoxelizeRequest& request,
                                         const RunOptions& options, ResultSink& sink) {
  if (options.backend != nullptr) return RunToSink(*options.backend, mesh, request, options, sink);
  ResumingSink resuming(sink);
  return RunOnChosen(request, options, [&](const Backend& backend, const RunOptions& once) {
    return RunToSink(backend, mesh, request, once, resuming);
  });
}

}  // namespace voxelpipe
