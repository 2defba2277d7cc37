// The tile: the unit that the sort-middle pipeline sorts triangles into and blends in fast memory.
#pragma once

#include <array>
#include <cstdint>

#include "base/host_device.h"
#include "raster/spans.h"

namespace voxelpipe {

// 32 voxels along x make a row of a tile one 32-bit word; four 8x8x8 bricks make a tile.
VOXELPIPE_HD constexpr int64_t TileDim(int axis) {
  return axis == 0 ? 32 : 8;
}  // voxels
inline constexpr int kTileVoxels = 32 * 8 * 8;
inline constexpr int kTileRows = 8 * 8;

// Widening of the tile binning, in tiles: far more than the rasterizer's own, so that binning misses no tile.
inline constexpr double kTileWidening = 1e-4;

struct TileGrid {
  int64_t dims[3];  // tiles an axis

  VOXELPIPE_HD uint64_t count() const { return uint64_t(dims[0]) * uint64_t(dims[1]) * uint64_t(dims[2]); }
  VOXELPIPE_HD uint64_t Index(int64_t x, int64_t y, int64_t z) const {
    return uint64_t(x) + uint64_t(dims[0]) * (uint64_t(y) + uint64_t(dims[1]) * uint64_t(z));
  }
};

VOXELPIPE_HD TileGrid TilesOf(const int64_t (&dims)[3]) {
  TileGrid tiles{};
  for (int a = 0; a < 3; ++a) tiles.dims[a] = (dims[a] + TileDim(a) - 1) / TileDim(a);
  return tiles;
}

// The voxels of a tile, clipped to the grid.
VOXELPIPE_HD VoxelRange TileVoxels(const TileGrid& tiles, uint64_t tile, const int64_t (&dims)[3]) {
  const int64_t at[3] = {int64_t(tile % uint64_t(tiles.dims[0])),
                         int64_t(tile / uint64_t(tiles.dims[0]) % uint64_t(tiles.dims[1])),
                         int64_t(tile / uint64_t(tiles.dims[0]) / uint64_t(tiles.dims[1]))};
  VoxelRange r;
  for (int a = 0; a < 3; ++a) {
    r.begin[a] = at[a] * TileDim(a);
    r.end[a] = Min(r.begin[a] + TileDim(a), dims[a]);
  }
  return r;
}

// The tiles of a triangle's box, a superset of those of its voxels, and the widening for SetUpAmongTiles.
struct TileBounds {
  VoxelRange box;  // in tiles
  double widening = kTileWidening;

  // True if the box has so few tiles that taking all of them is cheaper than the test. An extra tile costs only time.
  VOXELPIPE_HD bool few() const {
    return (box.end[0] - box.begin[0]) * (box.end[1] - box.begin[1]) * (box.end[2] - box.begin[2]) <= 4;
  }
};

VOXELPIPE_HD TileBounds BoundTiles(const TileGrid& tiles, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  TileBounds bounds;
  for (int i = 0; i < 3; ++i) {
    const double shrink = 1.0 / double(TileDim(i));
    const double lo = Min(a[i], Min(b[i], c[i])) * shrink, hi = Max(a[i], Max(b[i], c[i])) * shrink;
    const double slack = kTileWidening + (hi - lo) * 0x1p-30;
    bounds.widening = Max(bounds.widening, (hi - lo) * 0x1p-38);
    const double limit = double(tiles.dims[i]);
    bounds.box.begin[i] = int64_t(Clamp(floor(lo - slack), 0.0, limit));
    bounds.box.end[i] = int64_t(Clamp(floor(hi + slack) + 1, 0.0, limit));
  }
  return bounds;
}

// The triangle's set-up with tiles in place of voxels: coordinates are divided by the tile's dims, powers of two, so
// that the division is exact.
VOXELPIPE_HD TriangleSetup SetUpAmongTiles(const Vec3d& a, const Vec3d& b, const Vec3d& c, double widening) {
  const Vec3d shrink{1.0 / TileDim(0), 1.0 / TileDim(1), 1.0 / TileDim(2)};
  const auto scaled = [&](const Vec3d& p) { return Vec3d{p.x * shrink.x, p.y * shrink.y, p.z * shrink.z}; };
  return SetUpWideTriangle(scaled(a), scaled(b), scaled(c), Coverage::kConservative, widening);
}

VOXELPIPE_HD VoxelRange AllTiles(const TileGrid& tiles) {
  VoxelRange all;
  for (int i = 0; i < 3; ++i) all.end[i] = tiles.dims[i];
  return all;
}

// Calls visit(tile) for each tile that a triangle (index space) may touch: a superset of the tiles of its voxels, found
// by the row spans of SetUpAmongTiles.
template <typename Visit>
VOXELPIPE_HD void ForEachTile(const TileGrid& tiles, const Vec3d& a, const Vec3d& b, const Vec3d& c, Visit&& visit) {
  const TileBounds bounds = BoundTiles(tiles, a, b, c);
  const VoxelRange& box = bounds.box;
  if (box.empty()) return;
  const auto x_run = [&](int64_t y, int64_t z, int64_t x_begin, int64_t x_end) {
    for (int64_t x = x_begin; x < x_end; ++x) visit(tiles.Index(x, y, z));
  };
  if (bounds.few()) {
    for (int64_t z = box.begin[2]; z < box.end[2]; ++z) {
      for (int64_t y = box.begin[1]; y < box.end[1]; ++y) x_run(y, z, box.begin[0], box.end[0]);
    }
    return;
  }
  ForEachRowSpan(SetUpAmongTiles(a, b, c, bounds.widening), AllTiles(tiles), x_run);
}

}  // namespace voxelpipe
