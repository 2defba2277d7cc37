#include "calls/call_setup.h"

#include <chrono>
#include <utility>

#include "absl/strings/str_cat.h"
#include "pipeline/plan/plan.h"
#include "pipeline/stages/backend.h"
#include "wire/placed.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

constexpr std::chrono::milliseconds kRetryDelay{1000};

// Pieces up to this size are small.
constexpr size_t kSmallPieceBytes = 64 << 10;

}  // namespace

void SetDeadline(const grpc::CallbackServerContext& context, JobContext& job) {
  const auto deadline = context.deadline();
  const auto now = std::chrono::system_clock::now();
  // gRPC represents no deadline as a time in the far future; a century counts as none.
  if (deadline > now + std::chrono::hours(24 * 36500)) return;
  job.set_deadline(JobContext::Clock::now() + std::chrono::duration_cast<JobContext::Clock::duration>(deadline - now));
}

absl::Status ShuttingDownError() {
  return absl::UnavailableError("the server is shutting down");
}

absl::Status MayBegin(const CallGate::Pass& pass, const absl::Status& admission) {
  if (pass.full()) return BusyError("too many calls at the same time", kRetryDelay);
  return pass ? admission : ShuttingDownError();
}

absl::Status PrepareRequest(const ServiceState& state, VoxelizeRequest& request) {
  if (request.backend == BackendChoice::kAuto) request.backend = state.options.backend;
  if (request.simd == SimdChoice::kAuto) request.simd = state.options.simd;
  request.threads = state.options.threads;
  return ValidateRequest(request);
}

void ChooseKinds(const ServiceState& state, BackendChoice asked, const ParsedConfig& config, TaskTraits& traits) {
  traits.backend = config.request.backend;
  traits.fallback = state.options.fallback && config.settings.fallback.value_or(asked == BackendChoice::kAuto);
  // Without a fallback the job stays on one kind, the best.
  if (traits.backend == BackendChoice::kAuto && !traits.fallback) traits.backend = state.pool.best_kind();
}

absl::Status TakeUploadBytes(const ServiceState& state, uint64_t so_far, uint64_t bytes, BudgetShare& uploads) {
  const uint64_t limit = state.limits.load.max_file_bytes;
  if (so_far > limit || bytes > limit - so_far) {
    return absl::ResourceExhaustedError(absl::StrCat("the mesh file is larger than the limit of ", limit, " bytes"));
  }
  if (uploads.TryGrow(bytes)) return absl::OkStatus();
  return BusyError("too many meshes are being uploaded at the same time", kRetryDelay);
}

absl::Status TakeListBytes(const ParsedConfig& config, BudgetShare& uploads) {
  if (!config.placed || uploads.TryGrow(BytesOf(*config.placed))) return absl::OkStatus();
  return BusyError("too many requests with long lists of meshes at the same time", kRetryDelay);
}

void AppendPiece(std::string piece, std::deque<std::string>& pieces) {
  if (!pieces.empty() && pieces.back().size() + piece.size() <= kSmallPieceBytes) {
    pieces.back() += piece;
  } else {
    pieces.push_back(std::move(piece));
  }
}

}  // namespace voxelpipe
