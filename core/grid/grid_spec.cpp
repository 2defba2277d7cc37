#include "grid/grid_spec.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "absl/strings/str_cat.h"
#include "base/checked.h"

namespace voxelpipe {
namespace {

// Slack, in voxels: an extent that is a whole number of voxels, up to the rounding of the division and of float32
// corners, gets no extra layer.
double SlackOf(const Box3d& box, int axis, double voxel_size) {
  constexpr double kMinSlack = 1e-9, kMaxSlack = 4e-4, kFloatError = 0x1p-22;
  return std::max(
      kMinSlack,
      std::min(kMaxSlack, kFloatError * std::max(std::abs(box.min[axis]), std::abs(box.max[axis])) / voxel_size));
}

constexpr int64_t kManyVoxels = 1'000'000'000'000'000;  // an axis; larger counts are not computed
constexpr uint64_t kMaxVoxels = uint64_t{1} << 53;

bool FinitePositive(double v) {
  return std::isfinite(v) && v > 0;
}

absl::Status Invalid(const std::string& field, const std::string& why) {
  return absl::InvalidArgumentError(absl::StrCat("grid.", field, ": ", why));
}

// Number of voxels as an integer, saturated far above every limit, so that the check below rejects it.
int64_t CeilToDim(double voxels, double slack) {
  return static_cast<int64_t>(std::clamp(std::ceil(voxels - slack), 1.0, double(kManyVoxels)));
}

absl::StatusOr<GridSpec> Finish(GridSpec grid, int64_t padding) {
  uint64_t voxels = 1;
  for (int a = 0; a < 3; ++a) {
    grid.dims[a] += 2 * padding;
    grid.origin[a] -= double(padding) * grid.voxel_size[a];
    if (!FinitePositive(grid.voxel_size[a])) return Invalid("resolution", "the mesh is too small for this many voxels");
    if (!std::isfinite(grid.origin[a])) return Invalid("origin", "the grid's origin is not finite");
    if (grid.dims[a] > kMaxGridDim) {
      return absl::ResourceExhaustedError(
          absl::StrCat("grid: ", grid.dims[a] < kManyVoxels ? absl::StrCat(grid.dims[a]) : "more than 10^15",
                       " voxels along axis ", a, ", at most ", kMaxGridDim, " are possible"));
    }
    const auto product = CheckedMul(voxels, uint64_t(grid.dims[a]));
    if (!product || *product > kMaxVoxels) {
      return absl::ResourceExhaustedError(
          absl::StrCat("grid: ", grid.dims[0], " x ", grid.dims[1], " x ", grid.dims[2], " is beyond 2^53 voxels"));
    }
    voxels = *product;
  }
  return grid;
}

// Finish for a grid fitted to the box, and the walls on the axes where the box reaches beyond the grid.
absl::StatusOr<GridSpec> FinishFitted(const GridSpec& fitted, int64_t padding, const Box3d& box) {
  absl::StatusOr<GridSpec> grid = Finish(fitted, padding);
  if (!grid.ok()) return grid;
  const Vec3d farthest = WorldToIndex(grid->origin, grid->voxel_size, box.max);
  for (int a = 0; a < 3; ++a) {
    const double wall = double(fitted.dims[size_t(a)] + padding);
    if (!(farthest[a] > wall)) continue;
    grid->wall[a] = wall;
    grid->wall_end[a] = std::min(farthest[a], wall + SlackOf(box, a, grid->voxel_size[a]));
  }
  return grid;
}

// Places the grid, whose dims are set, around the box: cubic voxels, as small as the box allows; other axes centred.
void Center(const Box3d& box, const Vec3d& extent, GridSpec& grid) {
  int full = 0;  // the axis that the box fills
  for (int a = 1; a < 3; ++a) {
    if (extent[a] / double(grid.dims[a]) > extent[full] / double(grid.dims[full])) full = a;
  }
  const double h = extent[full] / double(grid.dims[full]);
  grid.voxel_size = {h, h, h};
  for (int a = 0; a < 3; ++a) {
    const double room = extent[full] * (double(grid.dims[a]) / double(grid.dims[full]));
    grid.origin[a] = box.min[a] - (room - extent[a]) / 2;
  }
}

}  // namespace

absl::Status CheckGridRequest(const GridRequest& request) {
  if (!request.voxel_size && !request.dims) {
    if (request.resolution < 1) return Invalid("resolution", "must be at least 1");
    if (request.resolution > kMaxGridDim) {
      return absl::ResourceExhaustedError(
          absl::StrCat("grid.resolution: ", request.resolution, " is beyond ", kMaxGridDim, " voxels an axis"));
    }
  }
  if (request.padding < 0) return Invalid("padding", "must not be negative");
  if (request.padding > kMaxGridDim) return Invalid("padding", absl::StrCat("must be at most ", kMaxGridDim));
  if (request.voxel_size) {
    for (int a = 0; a < 3; ++a) {
      if (!FinitePositive((*request.voxel_size)[a])) return Invalid("voxel_size", "must be finite and positive");
    }
  }
  if (request.dims) {
    for (const int64_t dim : *request.dims) {
      if (dim < 1) return Invalid("dims", "every axis needs at least 1 voxel");
    }
    if (request.origin && !request.voxel_size) {
      return Invalid("voxel_size", "a grid given by dims and origin needs a voxel size");
    }
    if (request.voxel_size && !request.origin) {
      return Invalid("origin",
                     "a grid given by dims and a voxel size needs an origin; dims alone are fitted to the mesh");
    }
  }
  if (request.fit == GridFit::kCube && (request.voxel_size || request.dims)) {
    return Invalid(
        "fit", absl::StrCat("a cube goes with a resolution, not with ", request.voxel_size ? "a voxel size" : "dims"));
  }
  if (request.origin) {
    if (!request.dims) return Invalid("dims", "an origin is given together with dims and a voxel size");
    for (int a = 0; a < 3; ++a) {
      if (!std::isfinite((*request.origin)[a])) return Invalid("origin", "must be finite");
    }
  }
  return absl::OkStatus();
}

Mat4d GridSpec::index_to_world() const {
  Mat4d m;
  for (int a = 0; a < 3; ++a) {
    m.m[a][a] = voxel_size[a];
    m.m[a][3] = origin[a] + 0.5 * voxel_size[a];
  }
  return m;
}

absl::StatusOr<GridSpec> FitGrid(const GridRequest& request, const Box3d& box) {
  if (absl::Status s = CheckGridRequest(request); !s.ok()) return s;
  GridSpec grid;
  if (request.given()) {
    grid.dims = *request.dims;
    grid.origin = *request.origin;
    grid.voxel_size = *request.voxel_size;
    return Finish(grid, request.padding);
  }
  const int64_t n = request.resolution;
  std::optional<std::array<int64_t, 3>> dims = request.dims;  // of a grid in which the box is centred
  if (!dims && !request.voxel_size && request.fit == GridFit::kCube) dims = {n, n, n};
  if (box.empty && dims) {
    grid.dims = *dims;
    return Finish(grid, request.padding);
  }
  if (box.empty) {  // no triangles: one clear voxel around the origin
    if (request.voxel_size) grid.voxel_size = *request.voxel_size;
    grid.origin = {-0.5 * grid.voxel_size.x, -0.5 * grid.voxel_size.y, -0.5 * grid.voxel_size.z};
    return grid;
  }
  const Vec3d extent = box.max - box.min;
  const double longest = std::max({extent.x, extent.y, extent.z});
  if (!std::isfinite(longest)) return Invalid("resolution", "the mesh's bounding box is not finite");
  if (request.voxel_size) {
    grid.voxel_size = *request.voxel_size;
    grid.origin = box.min;
    for (int a = 0; a < 3; ++a) {
      grid.dims[a] = CeilToDim(extent[a] / grid.voxel_size[a], SlackOf(box, a, grid.voxel_size[a]));
    }
    return FinishFitted(grid, request.padding, box);
  }
  if (dims) grid.dims = *dims;
  if (longest == 0) {
    for (int a = 0; a < 3; ++a) grid.origin[a] = box.min[a] - (double(grid.dims[a] / 2) + 0.5);
    return Finish(grid, request.padding);
  }
  if (dims) {
    Center(box, extent, grid);
    return FinishFitted(grid, request.padding, box);
  }
  const double h = longest / double(n);
  grid.voxel_size = {h, h, h};
  grid.origin = box.min;
  for (int a = 0; a < 3; ++a) {
    grid.dims[a] = extent[a] == longest ? n : CeilToDim(extent[a] / longest * double(n), SlackOf(box, a, h));
  }
  return FinishFitted(grid, request.padding, box);
}

}  // namespace voxelpipe
