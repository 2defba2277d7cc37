// How many voxels, bricks and tiles a surface touches follows from the Minkowski sum of a triangle T and a box B of
// edges e: averaged over all placements of a lattice of such boxes, T touches vol(T + B) / vol(B) of them, which is 1,
// plus its three widths over e, plus its three projected areas over the products of the other two edges. (R. Schneider
// and W. Weil, "Stochastic and Integral Geometry", 2008, section 5.1.) Constants were measured.
#include "pipeline/plan/surface.h"

#include <algorithm>
#include <cmath>

#include "raster/tiles.h"

namespace voxelpipe {
namespace {

constexpr double kBrickVoxels = 512;

constexpr double kRandomDirections = 0.555;  // E max|n| / E (|nx| + |ny| + |nz|) of a unit vector n

// Sums over the triangles, in voxels.
struct Sums {
  double triangles = 0;
  Vec3d area{}, width{};
  double main = 1;  // share of the areas that is the triangles' largest projection each
};

// True if areas in the box's units are neither too small nor too large for a double.
bool HasSquares(const Box3d& box) {
  constexpr double kMin = 1e-130, kMax = 1e130;  // voxels are smaller than the box by 2^40 at most
  double longest = 0;
  for (int a = 0; a < 3; ++a) longest = std::max(longest, box.max[a] - box.min[a]);
  return longest == 0 || (longest > kMin && longest < kMax);
}

Sums InVoxels(const GridSpec& grid, const MeshSize& mesh) {
  const Vec3d& h = grid.voxel_size;
  const MeshExtent& extent = mesh.extent;
  const Vec3d dims{double(grid.dims[0]), double(grid.dims[1]), double(grid.dims[2])};
  Sums out;
  out.triangles = double(mesh.triangles);
  out.main = kRandomDirections;
  Vec3d area{}, width{}, main{};
  if (extent.sums) {
    for (int a = 0; a < 3; ++a) {  // one division at a time: the square of a small voxel's edge may be 0
      area[a] = extent.sums->area[a] / h[(a + 1) % 3] / h[(a + 2) % 3];
      main[a] = extent.sums->dominant[a] / h[(a + 1) % 3] / h[(a + 2) % 3];
      width[a] = extent.sums->width[a] / h[a];
    }
  }
  const double areas = area.x + area.y + area.z, widths = width.x + width.y + width.z, mains = main.x + main.y + main.z;
  if (extent.sums && HasSquares(extent.box) && std::isfinite(areas) && std::isfinite(widths)) {
    out.triangles = extent.sums->triangles;
    out.main = areas > 0 ? mains / areas : 1;
  } else if (!extent.box.empty) {
    Vec3d d;
    for (int a = 0; a < 3; ++a) d[a] = (extent.box.max[a] - extent.box.min[a]) / h[a];
    area = {2 * d.y * d.z, 2 * d.z * d.x, 2 * d.x * d.y};
    width = Vec3d{1, 1, 1} * std::sqrt((area.x + area.y + area.z) * std::max(1.0, out.triangles));
  }
  // No triangle covers more than the grid's own sections, however far it reaches beyond it.
  const double n = std::max(out.triangles, double(mesh.triangles));
  for (int a = 0; a < 3; ++a) {
    out.area[a] = std::min(area[a], n * dims[(a + 1) % 3] * dims[(a + 2) % 3]);
    out.width[a] = std::min(width[a], n * dims[a]);
  }
  return out;
}

// Boxes of a lattice that the surface touches: `each` counts once a triangle, `once` those of a surface whose triangles
// are larger than the boxes or hang together.
struct Touched {
  double each, once;
};
Touched Touch(const Sums& surface, double triangles, const Vec3d& edges, double all) {
  double areas = 0, widths = 0;
  for (int a = 0; a < 3; ++a) {
    areas += surface.area[a] / (edges[(a + 1) % 3] * edges[(a + 2) % 3]);
    widths += surface.width[a] / edges[a];
  }
  const double each = areas + widths + triangles;
  return {each, std::min({each, 1.12 * areas + 64, all})};
}

// Fragments of triangles that touch `touched` voxels. Inside a large triangle every coverage keeps its largest
// projection. Of a point's voxels and of those along an edge thin coverage keeps the more, the nearer normals are to
// the axes. The two shares were measured: 0.8 and 0.67 of triangles in random directions.
double Fragments(const Sums& sums, Coverage coverage, double touched) {
  const double areas = sums.area.x + sums.area.y + sums.area.z, widths = sums.width.x + sums.width.y + sums.width.z;
  if (coverage == Coverage::kConservative || !(areas > 0)) return touched;
  if (coverage == Coverage::kCenter) return sums.main * areas;
  const double of_points = 1 - 0.45 * (1 - sums.main), of_edges = 1 - 0.74 * (1 - sums.main);
  return of_points * sums.triangles + of_edges * widths + sums.main * areas;
}

}  // namespace

GridWindow WindowOf(const GridRequest& request) {
  GridWindow window;
  if (request.voxel_size) window.voxel_size = *request.voxel_size;
  if (!request.given()) return window;
  const absl::StatusOr<GridSpec> grid = FitGrid(request, {});
  if (!grid.ok()) return window;  // who plans says why
  window.origin = grid->origin;
  window.voxel_size = grid->voxel_size;
  for (int a = 0; a < 3; ++a) window.dims[a] = double(grid->dims[size_t(a)]);
  return window;
}

Surface EstimateSurface(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh) {
  const Sums sums = InVoxels(grid, mesh);
  const double n = sums.triangles, all = double(grid.voxels());
  const Vec3d tile{double(TileDim(0)), double(TileDim(1)), double(TileDim(2))};
  const Touched voxels = Touch(sums, n, {1, 1, 1}, all);
  const Touched bricks = Touch(sums, n, {8, 8, 8}, all / kBrickVoxels + 1);
  const Touched tiles = Touch(sums, n, tile, all / kTileVoxels + 1);
  const double share = request.coverage == Coverage::kConservative ? 1 : sums.main;
  Surface out;
  out.fragments = Fragments(sums, request.coverage, voxels.each);
  out.rows = std::min(out.fragments, (n + sums.width.y + sums.width.z + sums.area.x) * share + out.fragments / 32);
  out.pairs = tiles.each;
  out.voxels = std::min(voxels.once * share, out.fragments);
  out.bricks = bricks.once;
  out.tiles = tiles.once;
  out.crossings = sums.area.x;
  out.layers = n + sums.width.z;
  if (request.coverage == Coverage::kNone) {
    out.fragments = out.rows = out.pairs = out.voxels = out.bricks = out.tiles = 0;
  }
  out.filled_bricks = out.bricks;
  if (request.fill != Fill::kNone) {
    const Vec3d& h = grid.voxel_size;
    const double volume = mesh.extent.sums ? std::abs(mesh.extent.sums->volume) / h.x / h.y / h.z : 0;
    out.inside = volume > 0 ? std::max(0.0, std::min(all, volume + 0.5 * out.voxels) - out.voxels) : all - out.voxels;
    out.filled_bricks = std::min(all / kBrickVoxels + 1, (out.inside + out.voxels) / kBrickVoxels + out.bricks);
  }
  return out;
}

Surface RescaleSurface(const Surface& surface, const VoxelizeRequest& request, const GridSpec& from, const GridSpec& to,
                       uint64_t triangles) {
  double volume = 1;
  for (int a = 0; a < 3; ++a) volume *= to.voxel_size[a] / from.voxel_size[a];
  const double coarser = std::cbrt(volume);
  // The terms of the Minkowski sum. Centres are covered in proportion to areas alone.
  const bool centers = request.coverage == Coverage::kCenter;
  const double n = centers ? 0 : std::min({double(triangles), surface.layers, surface.fragments});
  const double widths = centers ? 0 : std::clamp(3 * (surface.layers - n), 0.0, surface.fragments - n);
  const double areas = std::max(0.0, surface.fragments - n - widths);
  const auto each = [&](double edge) { return n + widths / edge + areas / (edge * edge); };
  const auto once = [&](double edge) { return std::min(each(edge), 1.12 * areas / (edge * edge) + 64); };
  const auto ratio = [&](const auto& count, double edge) { return count(edge * coarser) / std::max(1.0, count(edge)); };
  const double all = double(to.voxels()), fragments = ratio(each, 1);
  constexpr double kTileEdge = 11;  // a cube that a surface touches as often as a tile of 32x8x8 voxels
  Surface out = surface;
  out.fragments *= fragments;
  out.rows = std::min(out.fragments, surface.rows * fragments + out.fragments / 32);
  out.pairs *= ratio(each, kTileEdge);
  out.voxels = std::min({surface.voxels * ratio(once, 1), out.fragments, all});
  out.bricks *= ratio(once, 8);
  out.tiles *= ratio(once, kTileEdge);
  const double in_all = std::min(double(triangles), surface.layers);
  out.layers = in_all + (surface.layers - in_all) / coarser;
  out.crossings /= coarser * coarser;
  out.inside = std::min(all - out.voxels, surface.inside / volume);
  out.filled_bricks = out.bricks + (surface.filled_bricks - surface.bricks) / volume;
  if (surface.shares.empty()) return out;
  out.shares.assign(size_t((to.dims[2] + surface.share_layers - 1) / surface.share_layers), {});
  for (size_t i = 0; i < surface.shares.size(); ++i) {
    const double at = (double(i) + 0.5) * double(to.dims[2]) / double(from.dims[2]);
    Surface::Share& share = out.shares[std::min(size_t(at), out.shares.size() - 1)];
    share.fragments += surface.shares[i].fragments * fragments;
    share.bricks += surface.shares[i].bricks * out.bricks / std::max(1.0, surface.bricks);
  }
  return out;
}

Surface MostOfSlab(const Surface& surface, const GridSpec& grid, int64_t layers) {
  if (layers >= grid.dims[2]) return surface;
  const double even = double(layers) / double(grid.dims[2]);
  double fragments = even, bricks = even;
  if (!surface.shares.empty()) {
    // Slabs begin at multiples of their layers; a share that reaches into two counts for both.
    fragments = bricks = 0;
    const auto count = int64_t(surface.shares.size());
    for (int64_t z = 0; z < grid.dims[2]; z += layers) {
      const int64_t first = z / surface.share_layers;
      const int64_t last = std::min(count - 1, (std::min(z + layers, grid.dims[2]) - 1) / surface.share_layers);
      Surface::Share sum;
      for (int64_t i = first; i <= last; ++i) {
        sum.fragments += surface.shares[size_t(i)].fragments;
        sum.bricks += surface.shares[size_t(i)].bricks;
      }
      fragments = std::max(fragments, sum.fragments / std::max(1.0, surface.fragments));
      bricks = std::max(bricks, sum.bricks / std::max(1.0, surface.bricks));
    }
    fragments = std::min(1.0, fragments);
    bricks = std::min(1.0, bricks);
  }
  Surface out;
  out.fragments = surface.fragments * fragments;
  out.rows = surface.rows * fragments;
  out.pairs = surface.pairs * fragments;
  out.voxels = std::min({surface.voxels, out.fragments, surface.voxels * std::max(fragments, bricks)});
  out.bricks = surface.bricks * bricks;
  out.tiles = surface.tiles * bricks;
  out.crossings = surface.crossings * fragments;
  out.layers = surface.layers * fragments;
  const double voxels = double(grid.dims[0]) * double(grid.dims[1]) * double(layers);
  out.inside = std::min({surface.inside, voxels, surface.inside * 2 * even});
  out.filled_bricks = std::min({surface.filled_bricks, voxels / kBrickVoxels + 1,
                                out.bricks + (surface.filled_bricks - surface.bricks) * 2 * even});
  return out;
}

}  // namespace voxelpipe
