#include "gpu/parity/memory_parity.h"

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "base/device_failure.h"
#include "gpu/parity/first_difference.h"
#include "gpu/parity/parity_run.h"
#include "pipeline/voxelize.h"
#include "support/meshes/meshes.h"
#ifdef VOXELPIPE_HAVE_CUDA
#include "cuda/device/device.h"
#endif

namespace voxelpipe::gpu {

std::string Message(const absl::Status& status) {
  return absl::StrCat(absl::StatusCodeToString(status.code()), ": ", std::string(status.message()));
}

ParityCase CaseOfRanges() {
  ParityCase c;
  c.request.grid = Placed({70, 57, 8}, {-1, -0.1, -0.5}, {0.61, 0.11, 0.9});
  c.request.parts.scope = PartScope::kNode;
  c.request.fill = Fill::kNonzero;
  c.request.coverage = Coverage::kNone;
  c.request.targets[0].format = VoxelFormat::kU16;
  c.request.targets[0].blend = Blend::kReplace;
  c.request.targets[0].shader = {"label", {}};
  return c;
}

std::optional<std::string> RowsInRanges(const TriangleMesh& mesh, ParityCase c) {
#ifdef VOXELPIPE_HAVE_CUDA
  c.request.backend = BackendChoice::kCpu;
  const absl::StatusOr<Delivered> expected = Run(mesh, c);
  if (!expected.ok()) return Message(expected.status());
  c.request.backend = BackendChoice::kCuda;
  constexpr uint64_t kEnough = 3 << 19;
  for (uint64_t room = 12 << 20; room >= 1 << 10; room /= 2) {
    cuda::LimitMemory(cuda::MemoryTaken() + room);
    const absl::StatusOr<Delivered> got = Run(mesh, c);
    cuda::LimitMemory(UINT64_MAX);
    if (got.ok()) {
      if (const auto difference = FirstDifference(*expected, *got)) return absl::StrCat(room, " bytes: ", *difference);
      continue;
    }
    const std::string why = Message(got.status());
    const bool says_need = absl::StrContains(why, "bytes of device memory needed");
    if (absl::StartsWith(why, "RESOURCE_EXHAUSTED") && says_need && room < kEnough) return std::nullopt;
    return absl::StrCat(room, " bytes: ", why);
  }
  return "1 KiB was enough";
#else
  (void)mesh, (void)c;
  return std::nullopt;
#endif
}

std::optional<std::string> MoreThanDevicesHave(std::string& refusal) {
  ParityCase c;
  c.request.backend = BackendChoice::kCuda;
  c.request.grid = Placed({28000, 28000, 8}, {0, 0, 0}, {1, 1, 1});
  c.request.targets[0].format = VoxelFormat::kF32;
  c.request.targets[0].components = 4;
  c.request.targets[0].blend = Blend::kMax;
  c.request.targets.resize(kMaxTargets, c.request.targets[0]);
  PlanLimits limits;
  limits.max_result_bytes = limits.max_working_bytes = limits.slab_bytes = UINT64_MAX / 4;
  const TriangleMesh mesh = testing::Cube(16);
  const absl::Status status = Voxelize(mesh, c.request, {JobContext(), limits}).status();
  c.request.grid.dims = {30000, 30000, 8};
  c.request.targets = {TargetSpec()};
  const absl::Status face = Voxelize(mesh, c.request, {JobContext(), limits}).status();
  for (const absl::Status& s : {status, face}) {
    if (!absl::IsResourceExhausted(s) || DeviceFailureOf(s) != DeviceFailureKind::kOutOfMemory) return Message(s);
  }
  c.request.grid.dims = {64, 64, 64};
  const absl::Status after = Voxelize(mesh, c.request, {JobContext()}).status();
  if (!after.ok()) return "afterwards: " + Message(after);
  refusal = Message(status);
  return std::nullopt;
}

}  // namespace voxelpipe::gpu
