#include "pipeline/planner.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "base/limit_error.h"
#include "base/text.h"
#include "pipeline/plan/footprint.h"
#include "pipeline/stages/backend.h"

namespace voxelpipe {
namespace {

// Numbers from here on stand for more than can be counted.
constexpr uint64_t kBeyondCount = uint64_t{1} << 63;
constexpr double kFinerStep = 1.01;    // between two voxel sizes that are looked at
constexpr int64_t kFinerSteps = 1394;  // to the coarsest one, 2^20 times what was asked for
// A measurement visits every triangle: so many are made before the search takes the best grid that it has.
constexpr int kMaxMeasurements = 3;

// Finds what would fit in place of a request that does not.
class FittingGrid {
 public:
  // `measured`: the surface of the grid that does not fit, or null.
  FittingGrid(const PlanInput& input, const GridSpec& grid, const Surface* measured, double scale)
      : input_(input), scale_(scale) {
    if (measured != nullptr) known_.emplace(Known{grid, *measured});
  }

  // The largest resolution below the one that was asked for, 0 if none fits. Of `dims`: that of the longest axis.
  int64_t LargestResolution() {
    // Lists are estimated anew for each grid: there the answer is exact to a hundredth.
    const bool dense = input_.request.result == ResultKind::kDense;
    const auto near = [dense](int64_t resolution) { return dense ? 1 : std::max<int64_t>(1, resolution / 100); };
    return Finest(std::min(Longest(), kMaxGridDim), near, [this](int64_t resolution) { return At(resolution); });
  }

  // The request with this resolution; of `dims`, in their proportions.
  GridRequest At(int64_t resolution) const {
    GridRequest grid = input_.request.grid;
    grid.resolution = resolution;
    if (!grid.dims) return grid;
    const double share = double(resolution) / double(Longest());
    for (int64_t& dim : *grid.dims) dim = std::max<int64_t>(1, int64_t(double(dim) * share));
    return grid;
  }

  // The grid request with the finest voxels of at least the size that was asked for, within a hundredth or so; none
  // where no size fits.
  std::optional<GridRequest> FinestVoxels() {
    const auto at = [this](int64_t step) { return Coarser(std::pow(kFinerStep, double(kFinerSteps - step))); };
    const int64_t step = Finest(
        kFinerSteps, [](int64_t) { return 1; }, at);
    return step > 0 ? std::optional(at(step)) : std::nullopt;
  }

  // Why the search ended early; OK where it did not.
  const absl::Status& stopped() const { return stopped_; }

 private:
  int64_t Longest() const {
    const GridRequest& grid = input_.request.grid;
    return grid.dims ? *std::max_element(grid.dims->begin(), grid.dims->end()) : grid.resolution;
  }

  struct Known {
    GridSpec grid;
    Surface surface;
  };

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

  // In: grids at(1), at(2), ..., each finer than the one before, of which at(count) does not fit; how far below the
  // finest one that fits an answer may lie. Out: the number of one that fits as measured, 0 if none does. The surface
  // that was measured last predicts which grid to measure next.
  template <typename Near, typename At>
  int64_t Finest(int64_t count, const Near& near, const At& at) {
    int64_t fits = 0, too_fine = count;
    for (int measured = 0; too_fine - fits > near(fits); ++measured) {
      if (measured >= kMaxMeasurements && fits > 0) break;
      int64_t next = fits;
      for (int64_t end = too_fine; end - next > 1;) {
        const int64_t middle = next + (end - next) / 2;
        (IsPredictedToFit(at(middle)) ? next : end) = middle;
      }
      if (fits > 0 && next - fits < near(fits)) break;
      // Predictions that keep failing are too optimistic.
      if (measured >= kMaxMeasurements) next /= 2;
      next = std::max<int64_t>(1, next);
      const bool as_measured = Fits(at(next));
      if (!stopped_.ok()) return 0;
      (as_measured ? fits : too_fine) = next;
    }
    return fits;
  }

  bool Fits(const GridSpec& grid, const Surface& surface) const {
    const Footprint need =
        input_.backend.Predict(input_.request, grid, input_.mesh, surface, input_.limits, input_.delivery);
    return double(need.result_bytes) * scale_ <= double(input_.limits.max_result_bytes) &&
           double(need.peak_bytes) * scale_ <= double(input_.limits.max_working_bytes);
  }

  // By the size of a dense result alone while no surface is known.
  bool IsPredictedToFit(const GridRequest& request) const {
    const absl::StatusOr<GridSpec> grid = FitGrid(request, input_.mesh.extent.box);
    if (!grid.ok()) return false;
    if (double(DenseResultBytes(input_.request, *grid)) * scale_ > double(input_.limits.max_result_bytes)) return false;
    if (!known_) return true;
    return Fits(*grid, RescaleSurface(known_->surface, input_.request, known_->grid, *grid, input_.mesh.triangles));
  }

  bool Fits(const GridRequest& request) {
    const absl::StatusOr<GridSpec> grid = FitGrid(request, input_.mesh.extent.box);
    if (!grid.ok()) return false;
    if (double(DenseResultBytes(input_.request, *grid)) * scale_ > double(input_.limits.max_result_bytes)) return false;
    absl::StatusOr<Surface> surface = input_.measure(*grid, /*closely=*/true);
    if (!surface.ok()) {
      stopped_ = surface.status();
      return false;
    }
    known_.emplace(Known{*grid, *std::move(surface)});
    return Fits(*grid, known_->surface);
  }

  const PlanInput& input_;
  const double scale_;
  std::optional<Known> known_;  // measured last
  absl::Status stopped_;
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

absl::Status GridTooLarge(const PlanInput& input, const GridSpec& grid, const Surface* measured, bool of_results,
                          uint64_t need_bytes, double scale) {
  const VoxelizeRequest& request = input.request;
  const PlanLimits& limits = input.limits;
  const Delivery delivery = input.delivery;
  FittingGrid fitting(input, grid, measured, scale);
  LimitError error;
  error.need_bytes = need_bytes < kBeyondCount ? need_bytes : 0;
  error.limit_bytes = of_results ? limits.max_result_bytes : limits.max_working_bytes;
  std::string hint;
  if (!request.grid.voxel_size) {
    error.largest_resolution = fitting.LargestResolution();
    const GridRequest largest = fitting.At(error.largest_resolution);
    hint = error.largest_resolution == 0 ? "no resolution fits"
           : largest.dims ? absl::StrCat("the largest dims that fit are ", absl::StrJoin(*largest.dims, ","))
                          : absl::StrCat("the largest resolution that fits is ", largest.resolution);
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
    return GridTooLarge(input, *grid, nullptr, true, result, 1);
  }
  absl::StatusOr<Surface> surface = measure(*grid, /*closely=*/false);
  if (!surface.ok()) return surface.status();
  Footprint need = backend.Predict(request, *grid, mesh, *surface, limits, delivery);
  const auto fits = [&](double doubt) {
    const double listed = request.result == ResultKind::kDense ? 1 : doubt;
    const double peak = double(need.peak_bytes) + (doubt - 1) * double(need.list_bytes);
    return listed * double(need.result_bytes) <= double(limits.max_result_bytes) &&
           peak <= double(limits.max_working_bytes);
  };
  if (!surface->closely && !fits(surface->doubt)) {
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
  if (fits(1)) return run;
  const bool result = plan.result_bytes > limits.max_result_bytes;
  return GridTooLarge(input, *grid, &run.surface, result, result ? plan.result_bytes : plan.peak_bytes, 1);
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
