#include "pipeline/plan.h"

#include <algorithm>
#include <cmath>

#include "absl/strings/str_cat.h"
#include "base/checked.h"
#include "grid/bit_grid.h"
#include "pipeline/backend.h"
#include "pipeline/limit_error.h"
#include "pipeline/result.h"
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
  if (target.scale) {
    const bool integer =
        target.format == VoxelFormat::kU8 || target.format == VoxelFormat::kU16 || target.format == VoxelFormat::kU32;
    if (!integer) return Invalid(field + ".scale", "is for integer formats");
    if (!std::isfinite(*target.scale)) return Invalid(field + ".scale", "must be finite");
  }
  if (!IsPowerOfTwo(target.quantum) || target.quantum < 0x1p-126 || target.quantum > 0x1p80) {
    return Invalid(field + ".quantum", "must be a power of two from 2^-126 to 2^80");
  }
  if (!std::isfinite(target.clear)) return Invalid(field + ".clear", "must be finite");
  if (!std::isfinite(target.fill_value)) return Invalid(field + ".fill_value", "must be finite");
  return absl::OkStatus();
}

// Whether a shader can drop fragments, so that a target keeps a presence bit of its own.
bool OwnPresence(const TargetSpec& target) {
  const ShaderInfo* info = FindShader(ShaderStage::kFragment, target.shader.name);
  return info != nullptr && info->can_discard;
}

// Fixed costs of the run besides grids, measured generously: arenas, tile buffers of each thread.
constexpr uint64_t kBaseBytes = 8 << 20;

// What a run will need, predicted.
struct Need {
  uint64_t result_bytes = 0, peak_bytes = 0;
  int64_t slab_depth = 1;
};

struct Size {
  uint64_t triangles, vertices;
  MeshExtent extent;
};

// Voxels that the mesh touches: see MeshExtent. Without measured areas, those of its box.
struct Touched {
  double fragments, voxels;
};
Touched PredictTouched(const GridSpec& grid, const Size& size) {
  const Vec3d& h = grid.voxel_size;
  Vec3d area = size.extent.projected_area, width = size.extent.width;
  if (area.x + area.y + area.z <= 0 && !size.extent.box.empty) {
    const Vec3d d = size.extent.box.max - size.extent.box.min;
    area = {2 * d.y * d.z, 2 * d.z * d.x, 2 * d.x * d.y};
    const double a_triangle = std::sqrt((area.x + area.y + area.z) / std::max(1.0, double(size.triangles)));
    width = Vec3d{1, 1, 1} * (a_triangle * double(size.triangles));
  }
  // No triangle covers more than the grid's own sections, however far it reaches beyond it.
  const double n = double(size.triangles);
  const double nx = double(grid.dims[0]), ny = double(grid.dims[1]), nz = double(grid.dims[2]);
  const double areas = std::min(area.x / (h.y * h.z), n * ny * nz) + std::min(area.y / (h.z * h.x), n * nz * nx) +
                       std::min(area.z / (h.x * h.y), n * nx * ny);
  const double widths =
      std::min(width.x / h.x, n * nx) + std::min(width.y / h.y, n * ny) + std::min(width.z / h.z, n * nz);
  const double all = double(grid.voxels());
  const double fragments = areas + widths + double(size.triangles);
  // Neighbours share the voxels of their common edge: on a surface of triangles larger than voxels the areas remain.
  return {fragments, std::min({fragments, 1.25 * areas + 64, all})};
}

uint64_t ListedBytes(const VoxelizeRequest& request, const GridSpec& grid, const Size& size) {
  const Touched touched = PredictTouched(grid, size);
  double value_bytes = 0;
  for (const TargetSpec& target : request.targets) {
    value_bytes += double(target.components) * double(BitsPerComponent(target.format)) / 8;
  }
  if (request.result == ResultKind::kBuckets) {
    return uint64_t(16 * touched.voxels + (4 + value_bytes) * touched.fragments);
  }
  double voxels = touched.voxels;
  if (request.fill != Fill::kNone) voxels = double(grid.voxels());
  const double bricks = std::min(double(grid.voxels()) / 512 + 1, touched.voxels / 40 + 8);
  return uint64_t(72 * (request.fill == Fill::kNone ? bricks : double(grid.voxels()) / 512 + 1) + value_bytes * voxels);
}

// The bit grids over `layers` layers that the stages hold besides the targets: coverage, inside bits of a fill, presence
// of targets whose shaders discard.
uint64_t BitGridBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t layers) {
  uint64_t grids = 1 + (request.fill == Fill::kNone ? 0 : 1);
  for (const TargetSpec& target : request.targets) {
    if (target.format == VoxelFormat::kBit && target.shader.name != "occupancy") ++grids;
    if (OwnPresence(target)) ++grids;
  }
  return grids * BitGrid::BytesFor({grid.dims[0], grid.dims[1], layers});
}

// Bytes of dense targets over `layers` layers.
uint64_t DenseBytes(const VoxelizeRequest& request, const GridSpec& grid, int64_t layers) {
  const uint64_t voxels = uint64_t(grid.dims[0]) * uint64_t(grid.dims[1]) * uint64_t(layers);
  uint64_t bytes = 0;
  for (const TargetSpec& target : request.targets) bytes += TargetBytes(target, voxels);
  return bytes;
}

// The working set of the CPU backend: what is held of the result, the slab's bits, the whole grid's two bits a voxel under
// flood, index-space vertices, and (tile, triangle) pairs at about two a triangle, held twice while they are gathered.
Need PredictNeed(const VoxelizeRequest& request, const GridSpec& grid, const Size& size, const PlanLimits& limits,
                 Delivery delivery) {
  const bool dense = request.result == ResultKind::kDense;
  Need need;
  need.result_bytes = dense ? DenseBytes(request, grid, grid.dims[2]) : ListedBytes(request, grid, size);
  // A slab's cost grows with its layers; lists are gathered whatever the slabs, so they take the layers' share of theirs.
  const auto slab_bytes = [&](int64_t layers) {
    const uint64_t list = dense ? 0 : uint64_t(2.0 * double(need.result_bytes) * double(layers) / double(grid.dims[2]));
    return DenseBytes(request, grid, dense ? layers : 0) + list + BitGridBytes(request, grid, layers);
  };
  int64_t depth = grid.dims[2];
  if (limits.slab_depth > 0) {
    depth = std::min(depth, limits.slab_depth);
  } else if (!dense || delivery == Delivery::kStream) {
    while (depth > kSlabGranularity && slab_bytes(depth) > limits.slab_bytes) depth = depth / 2;
  }
  if (depth < grid.dims[2])
    depth = std::min(grid.dims[2], (depth + kSlabGranularity - 1) / kSlabGranularity * kSlabGranularity);
  need.slab_depth = depth;

  const bool held = !dense || (delivery == Delivery::kMemory && depth < grid.dims[2]);
  const uint64_t vertex_bytes =
      request.vertex_shader.name == "identity" ? sizeof(Vec3d) : 2 * sizeof(Vec3d) + sizeof(Vec3f);
  need.peak_bytes = kBaseBytes + slab_bytes(depth) + (held ? need.result_bytes : 0) + size.vertices * vertex_bytes +
                    size.triangles * 2 * 2 * sizeof(uint64_t);
  if (request.fill == Fill::kFlood) need.peak_bytes += 2 * BitGrid::BytesFor(grid.dims);
  return need;
}

bool Fits(const Need& need, const PlanLimits& limits) {
  return need.result_bytes <= limits.max_result_bytes && need.peak_bytes <= limits.max_working_bytes;
}

// The largest resolution whose grid fits the limits, 0 if none does.
int64_t LargestResolution(VoxelizeRequest request, const Size& size, const PlanLimits& limits, Delivery delivery) {
  request.grid.dims.reset();
  request.grid.origin.reset();
  request.grid.voxel_size.reset();
  int64_t lo = 0, hi = kMaxGridDim;
  while (lo < hi) {
    const int64_t mid = lo + (hi - lo + 1) / 2;
    request.grid.resolution = mid;
    const auto grid = FitGrid(request.grid, size.extent.box);
    if (grid.ok() && Fits(PredictNeed(request, *grid, size, limits, delivery), limits)) {
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
  switch (fill) {
    case Fill::kNone: return "none";
    case Fill::kParity: return "parity";
    case Fill::kFlood: return "flood";
  }
  return "unknown";
}

std::string_view Name(SimdChoice simd) {
  switch (simd) {
    case SimdChoice::kAuto: return "auto";
    case SimdChoice::kScalar: return "scalar";
    case SimdChoice::kAvx2: return "avx2";
    case SimdChoice::kAvx512: return "avx512";
  }
  return "unknown";
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
  return ArrayBytes(ElementOf(target.format), voxels * uint64_t(target.components));
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
  if (request.result == ResultKind::kBuckets) {
    if (request.fill != Fill::kNone) return Invalid("fill", "buckets list fragments; there is nothing to fill");
    if (request.coverage == Coverage::kCenter) return Invalid("coverage", "buckets take conservative or thin");
  }
  if (request.threads < 0) return Invalid("threads", "must not be negative");
  return absl::OkStatus();
}

absl::StatusOr<Plan> PlanVoxelization(const VoxelizeRequest& request, uint64_t triangles, uint64_t vertices,
                                      const MeshExtent& extent, const PlanLimits& limits, Delivery delivery) {
  if (absl::Status s = ValidateRequest(request); !s.ok()) return s;
  const absl::StatusOr<const Backend*> backend = SelectBackend(request.backend);
  if (!backend.ok()) return backend.status();
  const absl::StatusOr<GridSpec> grid = FitGrid(request.grid, extent.box);
  if (!grid.ok()) return grid.status();
  Plan plan;
  plan.grid = *grid;
  plan.backend = std::string((*backend)->name());
  const Size size{triangles, vertices, extent};
  const Need need = PredictNeed(request, *grid, size, limits, delivery);
  plan.result_bytes = need.result_bytes;
  plan.peak_bytes = need.peak_bytes;
  plan.slab_depth = need.slab_depth;
  plan.time_class = GuessTime(plan, triangles);
  if (!Fits(need, limits)) {
    const bool result = plan.result_bytes > limits.max_result_bytes;
    const LimitError error{result ? plan.result_bytes : plan.peak_bytes,
                           result ? limits.max_result_bytes : limits.max_working_bytes,
                           LargestResolution(request, size, limits, delivery)};
    return MakeLimitError(
        absl::StrCat("grid ", grid->dims[0], "x", grid->dims[1], "x", grid->dims[2], " needs ", error.need_bytes,
                     result ? " bytes of results" : " bytes of memory", ", the limit is ", error.limit_bytes,
                     "; the largest resolution that fits is ", error.largest_resolution),
        error);
  }
  return plan;
}

}  // namespace voxelpipe
