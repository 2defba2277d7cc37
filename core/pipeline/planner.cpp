#include "pipeline/planner.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "base/text.h"
#include "pipeline/plan/footprint.h"
#include "pipeline/stages/backend.h"

namespace voxelpipe {
namespace {

// Numbers from here on stand for more than can be counted.
constexpr uint64_t kBeyondCount = uint64_t{1} << 63;
constexpr double kCoarsest = 0x1p20;  // times the voxel size that was asked for

// Finds what would fit in place of a request that does not.
class FittingGrid {
 public:
  FittingGrid(const PlanInput& input, double scale) : input_(input), scale_(scale) {}

  // The largest resolution below the one that was asked for, 0 if none fits.
  int64_t LargestResolution() const {
    VoxelizeRequest request = input_.request;
    int64_t lo = 0, hi = std::min(input_.request.grid.resolution, kMaxGridDim);
    // Lists are looked at anew for each grid: there the answer is exact to a hundredth.
    const auto near = [&] { return request.result == ResultKind::kDense ? 1 : std::max<int64_t>(1, lo / 100); };
    while (hi - lo > near() && stopped_.ok()) {
      const int64_t middle = lo + (hi - lo) / 2;
      request.grid.resolution = middle;
      (Fits(request.grid) ? lo : hi) = middle;
    }
    return lo;
  }

  // The grid request with the finest voxels of at least the size that was asked for, within a hundredth; none where no
  // size fits.
  std::optional<GridRequest> FinestVoxels() const {
    double lo = 1, hi = 2;
    for (; !Fits(Coarser(hi)); hi *= 2) {
      if (hi >= kCoarsest || !stopped_.ok()) return std::nullopt;
      lo = hi;
    }
    while (hi / lo > 1.01 && stopped_.ok()) {
      const double middle = std::sqrt(lo * hi);
      (Fits(Coarser(middle)) ? hi : lo) = middle;
    }
    return Coarser(hi);
  }

  // Why the search ended early; OK where it did not.
  const absl::Status& stopped() const { return stopped_; }

 private:
  // The same place in voxels that are so many times larger; of a grid that is given, as many of them as fill it
  // exactly.
  GridRequest Coarser(double factor) const {
    GridRequest grid = input_.request.grid;
    for (int a = 0; a < 3; ++a) {
      double times = factor;
      if (grid.dims) {
        const int64_t dim = (*grid.dims)[size_t(a)];
        const auto fewer = std::max<int64_t>(1, int64_t(double(dim) / factor));
        times = double(dim) / double(fewer);
        (*grid.dims)[size_t(a)] = fewer;
      }
      (*grid.voxel_size)[a] *= times;
    }
    return grid;
  }

  bool Fits(const GridRequest& request) const {
    const absl::StatusOr<GridSpec> grid = FitGrid(request, input_.mesh.extent.box);
    if (!grid.ok()) return false;
    if (double(DenseResultBytes(input_.request, *grid)) * scale_ > double(input_.limits.max_result_bytes)) return false;
    const absl::StatusOr<Surface> surface = input_.measure(*grid, /*closely=*/true);
    if (!surface.ok()) {
      stopped_ = surface.status();
      return false;
    }
    const Footprint need =
        input_.backend.Predict(input_.request, *grid, input_.mesh, *surface, input_.limits, input_.delivery);
    return double(need.result_bytes) * scale_ <= double(input_.limits.max_result_bytes) &&
           double(need.peak_bytes) * scale_ <= double(input_.limits.max_working_bytes);
  }

  const PlanInput& input_;
  const double scale_;
  mutable absl::Status stopped_;
};

std::string Three(const Vec3d& v) {
  if (v.x == v.y && v.y == v.z) return ExactText(v.x);
  return absl::StrCat(ExactText(v.x), ",", ExactText(v.y), ",", ExactText(v.z));
}

TimeClass GuessTime(const Plan& plan, uint64_t triangles) {
  // Microseconds on two cores, measured: about half a microsecond a triangle, a byte touched about a nanosecond.
  const double us = 0.5 * double(triangles) + 1e-3 * double(plan.peak_bytes);
  return us < 1e5 ? TimeClass::kInstant : us < 2e6 ? TimeClass::kShort : TimeClass::kLong;
}

}  // namespace

absl::Status GridTooLarge(const PlanInput& input, const GridSpec& grid, bool of_results, uint64_t need_bytes,
                          double scale) {
  const VoxelizeRequest& request = input.request;
  const PlanLimits& limits = input.limits;
  const Delivery delivery = input.delivery;
  const FittingGrid fitting(input, scale);
  LimitError error;
  error.need_bytes = need_bytes < kBeyondCount ? need_bytes : 0;
  error.limit_bytes = of_results ? limits.max_result_bytes : limits.max_working_bytes;
  std::string hint;
  if (!request.grid.voxel_size) {
    error.largest_resolution = fitting.LargestResolution();
    hint = error.largest_resolution > 0 ? absl::StrCat("the largest resolution that fits is ", error.largest_resolution)
                                        : "no resolution fits";
  } else if (const std::optional<GridRequest> finest = fitting.FinestVoxels()) {
    error.smallest_voxel_size = *finest->voxel_size;
    hint = absl::StrCat("the smallest voxel size that fits is ", Three(*finest->voxel_size));
    if (finest->dims) {
      const auto& dims = *finest->dims;
      absl::StrAppend(&hint, ", with dims ", dims[0], ",", dims[1], ",", dims[2]);
    }
  } else {
    hint = "no voxel size fits";
  }
  if (!fitting.stopped().ok()) return fitting.stopped();
  const std::string need = need_bytes < kBeyondCount ? absl::StrCat(scale > 1 ? "at least " : "", BytesText(need_bytes))
                                                     : "more than 2^63 bytes";
  const std::string what = of_results ? "results" : "memory";
  // Why the same grid may pass where its result is handed on in slabs.
  const bool whole = !of_results && delivery == Delivery::kMemory && request.result == ResultKind::kDense;
  const std::string of_limit = of_results ? "" : std::string(limits.working_limit_is);
  return MakeLimitError(
      absl::StrCat("grid ", grid.dims[0], "x", grid.dims[1], "x", grid.dims[2], " needs ", need, " of ", what,
                   whole ? ", where its whole result is held" : "", "; the limit of ", what, " is ",
                   BytesText(error.limit_bytes), of_limit.empty() ? "" : ", ", of_limit, "; ", hint),
      error);
}

absl::StatusOr<PlannedRun> PlanOn(const PlanInput& input) {
  const auto& [backend, request, mesh, measure, limits, delivery] = input;
  const absl::StatusOr<GridSpec> grid = FitGrid(request.grid, mesh.extent.box);
  if (!grid.ok()) return grid.status();
  if (const uint64_t result = DenseResultBytes(request, *grid); result > limits.max_result_bytes) {
    return GridTooLarge(input, *grid, true, result, 1);
  }
  absl::StatusOr<Surface> surface = measure(*grid, /*closely=*/false);
  if (!surface.ok()) return surface.status();
  Footprint need = backend.Predict(request, *grid, mesh, *surface, limits, delivery);
  const auto fits = [&need, &bounds = limits] {
    return need.result_bytes <= bounds.max_result_bytes && need.peak_bytes <= bounds.max_working_bytes;
  };
  if (!fits()) {
    surface = measure(*grid, /*closely=*/true);
    if (!surface.ok()) return surface.status();
    need = backend.Predict(request, *grid, mesh, *surface, limits, delivery);
  }
  PlannedRun run;
  run.surface = *std::move(surface);
  Plan& plan = run.plan;
  plan.grid = *grid;
  plan.backend = std::string(backend.name());
  plan.result_bytes = need.result_bytes;
  plan.peak_bytes = need.peak_bytes;
  plan.list_bytes = need.list_bytes;
  plan.slab_depth = need.slab_depth;
  plan.time_class = GuessTime(plan, mesh.triangles);
  if (fits()) return run;
  const bool result = plan.result_bytes > limits.max_result_bytes;
  return GridTooLarge(input, *grid, result, result ? plan.result_bytes : plan.peak_bytes, 1);
}

absl::StatusOr<Plan> PlanVoxelization(const Backend& backend, const VoxelizeRequest& request, uint64_t triangles,
                                      uint64_t vertices, const MeshExtent& extent, const PlanLimits& limits,
                                      Delivery delivery) {
  if (absl::Status s = ValidateRequest(request); !s.ok()) return s;
  const MeshSize mesh{triangles, vertices, extent};
  const auto measure = [&](const GridSpec& grid, bool) -> absl::StatusOr<Surface> {
    return EstimateSurface(request, grid, mesh);
  };
  absl::StatusOr<PlannedRun> run = PlanOn({backend, request, mesh, measure, limits, delivery});
  if (!run.ok()) return run.status();
  return std::move(run->plan);
}

absl::StatusOr<Plan> PlanVoxelization(const VoxelizeRequest& request, uint64_t triangles, uint64_t vertices,
                                      const MeshExtent& extent, const PlanLimits& limits, Delivery delivery) {
  const absl::StatusOr<const Backend*> backend = SelectBackend(request.backend);
  if (!backend.ok()) return backend.status();
  return PlanVoxelization(**backend, request, triangles, vertices, extent, limits, delivery);
}

}  // namespace voxelpipe
