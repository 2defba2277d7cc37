// Grids: dims, placement, and fitting a grid to a mesh's box.
#pragma once

#include <array>
#include <cstdint>
#include <optional>

#include "absl/status/statusor.h"
#include "base/vec.h"
#include "grid/index_space.h"

namespace voxelpipe {

// A regular grid of voxels. Voxel (i,j,k) spans [i,i+1)x[j,j+1)x[k,k+1) in index space, where
// index = (p - origin) / voxel_size per axis, in double. Linear order is x fastest: n = i + nx*(j + ny*k).
struct GridSpec {
  std::array<int64_t, 3> dims{1, 1, 1};  // nx, ny, nz; each at least 1
  Vec3d origin{};                        // world position of index (0,0,0), the corner of the first voxel
  Vec3d voxel_size{1, 1, 1};             // world units a voxel, per axis, each > 0
  // Of fitted grids: as in IndexSpace.
  Vec3d wall{IndexSpace::kNoWall, IndexSpace::kNoWall, IndexSpace::kNoWall}, wall_end = wall;

  // nx*ny*nz. Fits 64 bits for every spec that FitGrid returns.
  uint64_t voxels() const { return uint64_t(dims[0]) * uint64_t(dims[1]) * uint64_t(dims[2]); }
  // Maps (i,j,k,1) to the world position of that voxel's centre (hence the +0.5). Row major.
  Mat4d index_to_world() const;

  // The transform of vertices to index space.
  IndexSpace index_space() const { return {origin, voxel_size, wall, wall_end}; }

  // True if they have the same voxels.
  friend bool operator==(const GridSpec& a, const GridSpec& b) {
    return a.dims == b.dims && a.origin == b.origin && a.voxel_size == b.voxel_size;
  }
};

enum class GridFit : uint8_t { kTight, kCube };

// The grid as a request gives it, in one of four forms; the resolution is not read beside another one, `fit` neither:
//   resolution                       N voxels along the longest extent, placed by `fit` (the default, 128)
//   voxel_size                       origin at the box's minimum, as many voxels as it needs
//   dims                             so many voxels, in which the box is centred
//   voxel_size + dims + origin       the grid itself
struct GridRequest {
  int64_t resolution = 128;
  GridFit fit = GridFit::kTight;
  std::optional<Vec3d> voxel_size;
  std::optional<std::array<int64_t, 3>> dims;
  std::optional<Vec3d> origin;
  int64_t padding = 0;  // voxels on every side; dims + 2P, origin - P*h

  // True if the request gives the grid itself, whatever the mesh.
  bool given() const { return dims && origin && voxel_size; }
};

struct Box3d {
  Vec3d min{}, max{};
  bool empty = true;
};

inline constexpr int64_t kMaxGridDim = int64_t{1} << 20;  // voxels an axis

// OK if FitGrid takes the request for every mesh that is not too large for it. Errors: as of FitGrid.
absl::Status CheckGridRequest(const GridRequest& request);

// In: a request and the box of the vertices that triangles use, after the vertex shader, in world units.
// Out: the grid. `tight` gives axes of the longest extent L exactly N voxels, h = L/N, the others
// max(1, ceil(extent/L*N - slack)). `dims` alone gives cubic voxels of h = max(extent/dim) and centres the box; `cube`
// is N x N x N of them. L = 0: one voxel of size 1 centred on the point or, with `dims` or `cube`, so many, of which
// voxel floor(dim/2) an axis is; an empty box: one around 0, with `dims` or `cube` so many from 0 on. The slack is the
// bound of the float32 rounding error, in voxels: max(1e-9, min(4e-4, 2^-22 * max(|min|, |max|) / h)) of each axis.
// Points beyond the last voxel by at most the slack count as lying on its far side (IndexSpace). Errors:
// INVALID_ARGUMENT naming the field (resolution < 1, voxel_size not finite or <= 0, origin without dims, ...);
// RESOURCE_EXHAUSTED for a grid beyond kMaxGridDim an axis or 2^53 voxels.
absl::StatusOr<GridSpec> FitGrid(const GridRequest& request, const Box3d& box);

}  // namespace voxelpipe
