#include "pipeline/plan.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "base/checked.h"
#include "grid/bit_grid.h"
#include "pipeline/backend.h"
#include "shaders/catalog.h"

namespace voxelpipe {
namespace {

absl::Status At(const std::string& field, const absl::Status& why) {
  return absl::Status(why.code(), absl::StrCat(field, ": ", why.message()));
}

absl::Status Invalid(const std::string& field, const std::string& why) {
  return absl::InvalidArgumentError(absl::StrCat(field, ": ", why));
}

bool IsPowerOfTwo(double v) {
  int exponent;
  return std::isfinite(v) && v > 0 && std::frexp(v, &exponent) == 0.5;
}

absl::Status ValidateTarget(const TargetSpec& target, const std::string& field) {
  if (target.components < 1 || target.components > 4) return Invalid(field + ".components", "must be 1 to 4");
  if (target.format == VoxelFormat::kBit && target.components != 1) {
    return Invalid(field + ".components", "a bit target has 1 component");
  }
  if (absl::Status s = CheckBlend(target.format, target.blend); !s.ok()) return At(field + ".blend", s);
  if (auto shader = BindShader(ShaderStage::kFragment, target.shader); !shader.ok()) {
    return At(field + ".shader", shader.status());
  }
  if (!IsPowerOfTwo(target.quantum) || target.quantum < 0x1p-126 || target.quantum > 0x1p80) {
    return Invalid(field + ".quantum", "must be a power of two from 2^-126 to 2^80");
  }
  if (!std::isfinite(target.clear)) return Invalid(field + ".clear", "must be finite");
  if (!std::isfinite(target.fill_value)) return Invalid(field + ".fill_value", "must be finite");
  return absl::OkStatus();
}

// Fixed costs of the run besides grids, measured generously: arenas, tile buffers of each thread.
constexpr uint64_t kBaseBytes = 8 << 20;

uint64_t ResultBytes(const VoxelizeRequest& request, const GridSpec& grid) {
  uint64_t bytes = 0;
  for (const TargetSpec& target : request.targets) bytes += TargetBytes(target, grid.voxels());
  return bytes;
}

// The working set of the CPU backend: result, coverage bits, value bits of bit targets that are not plain occupancy,
// inside bits of the fill, index-space vertices, and (tile, triangle) pairs at about two a triangle, held twice while they
// are gathered.
uint64_t PeakBytes(const VoxelizeRequest& request, const GridSpec& grid, uint64_t triangles, uint64_t vertices) {
  uint64_t grids = 1 + (request.fill == Fill::kNone ? 0 : 1);
  for (const TargetSpec& target : request.targets) {
    if (target.format == VoxelFormat::kBit && target.shader.name != "occupancy") ++grids;
    if (target.shader.name == "base_color") ++grids;
  }
  const uint64_t vertex_bytes =
      request.vertex_shader.name == "identity" ? sizeof(Vec3d) : 2 * sizeof(Vec3d) + sizeof(Vec3f);
  return kBaseBytes + ResultBytes(request, grid) + grids * BitGrid::BytesFor(grid.dims) + vertices * vertex_bytes +
         triangles * 2 * 2 * sizeof(uint64_t);
}

bool Fits(const VoxelizeRequest& request, const GridSpec& grid, uint64_t triangles, uint64_t vertices,
          const PlanLimits& limits) {
  return ResultBytes(request, grid) <= limits.max_result_bytes &&
         PeakBytes(request, grid, triangles, vertices) <= limits.max_working_bytes;
}

// The largest resolution whose grid fits the limits, 0 if none does.
int64_t LargestResolution(VoxelizeRequest request, uint64_t triangles, uint64_t vertices, const Box3d& box,
                          const PlanLimits& limits) {
  request.grid.dims.reset();
  request.grid.origin.reset();
  request.grid.voxel_size.reset();
  int64_t lo = 0, hi = kMaxGridDim;
  while (lo < hi) {
    const int64_t mid = lo + (hi - lo + 1) / 2;
    request.grid.resolution = mid;
    const auto grid = FitGrid(request.grid, box);
    if (grid.ok() && Fits(request, *grid, triangles, vertices, limits)) {
      lo = mid;
    } else {
      hi = mid - 1;
    }
  }
  return lo;
}

TimeClass GuessTime(const Plan& plan, uint64_t triangles) {
  // Microseconds on two cores, measured: about half a microsecond a triangle, a byte touched about a nanosecond.
  const double us = 0.5 * double(triangles) + 1e-3 * double(plan.peak_bytes);
  return us < 1e5 ? TimeClass::kInstant : us < 2e6 ? TimeClass::kShort : TimeClass::kLong;
}

}  // namespace

std::string_view Name(Coverage coverage) {
  switch (coverage) {
    case Coverage::kConservative: return "conservative";
    case Coverage::kThin: return "thin";
    case Coverage::kCenter: return "center";
  }
  return "unknown";
}

std::string_view Name(Fill fill) {
  return fill == Fill::kParity ? "parity" : "none";
}

std::string_view Name(BackendChoice backend) {
  switch (backend) {
    case BackendChoice::kAuto: return "auto";
    case BackendChoice::kCpu: return "cpu";
    case BackendChoice::kCuda: return "cuda";
  }
  return "unknown";
}

uint64_t TargetBytes(const TargetSpec& target, uint64_t voxels) {
  if (target.format == VoxelFormat::kBit) return (voxels + 7) / 8;
  return voxels * uint64_t(target.components) * sizeof(float);
}

absl::Status ValidateRequest(const VoxelizeRequest& request) {
  if (auto shader = BindShader(ShaderStage::kVertex, request.vertex_shader); !shader.ok()) {
    return At("vertex_shader", shader.status());
  }
  if (request.targets.empty()) return Invalid("targets", "at least one is needed");
  if (request.targets.size() > size_t{kMaxTargets}) {
    return Invalid("targets",
                   absl::StrCat("at most ", kMaxTargets, " are possible, ", request.targets.size(), " given"));
  }
  for (size_t i = 0; i < request.targets.size(); ++i) {
    if (absl::Status s = ValidateTarget(request.targets[i], absl::StrCat("targets[", i, "]")); !s.ok()) return s;
  }
  if (request.threads < 0) return Invalid("threads", "must not be negative");
  return absl::OkStatus();
}

absl::StatusOr<Plan> PlanVoxelization(const VoxelizeRequest& request, uint64_t triangles, uint64_t vertices,
                                      const Box3d& shaded_box, const PlanLimits& limits) {
  if (absl::Status s = ValidateRequest(request); !s.ok()) return s;
  const absl::StatusOr<const Backend*> backend = SelectBackend(request.backend);
  if (!backend.ok()) return backend.status();
  const absl::StatusOr<GridSpec> grid = FitGrid(request.grid, shaded_box);
  if (!grid.ok()) return grid.status();
  Plan plan;
  plan.grid = *grid;
  plan.backend = std::string((*backend)->name());
  plan.result_bytes = ResultBytes(request, *grid);
  plan.peak_bytes = PeakBytes(request, *grid, triangles, vertices);
  plan.time_class = GuessTime(plan, triangles);
  if (!Fits(request, *grid, triangles, vertices, limits)) {
    const bool result = plan.result_bytes > limits.max_result_bytes;
    return absl::ResourceExhaustedError(absl::StrCat(
        "grid ", grid->dims[0], "x", grid->dims[1], "x", grid->dims[2], " needs ",
        result ? plan.result_bytes : plan.peak_bytes, result ? " bytes of results" : " bytes of memory",
        ", the limit is ", result ? limits.max_result_bytes : limits.max_working_bytes,
        "; the largest resolution that fits is ", LargestResolution(request, triangles, vertices, shaded_box, limits)));
  }
  return plan;
}

}  // namespace voxelpipe
