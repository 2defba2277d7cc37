// What a mesh touches of a grid: the numbers that a run's memory follows from.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "grid/grid_spec.h"
#include "job/request.h"
#include "raster/surface_sums.h"

namespace voxelpipe {

// Where a shaded mesh lies and how large its surface is, in world units.
struct MeshExtent {
  Box3d box;                       // of the vertices that triangles use
  uint64_t triangles_outside = 0;  // whose boxes lie beside the grid that the request gives; 0 where it is fitted
  // What the stages hold of the mesh besides the caller's: what the vertex shader made of the vertices, and copies on
  // their way to a device and there. 0 where the shader left the vertices alone, or did not run.
  uint64_t held_bytes = 0;
  // Absent where they were not made: stages that look at the triangles again once the grid is known (Stages::Measure)
  // leave them out.
  std::optional<SurfaceSums> sums;
};

// The grid of a request that gives it (GridRequest::given), and so before the mesh's box is known.
GridWindow WindowOf(const GridRequest& request);

struct MeshSize {
  uint64_t triangles = 0, vertices = 0;
  MeshExtent extent;
};

// Estimates, of the part of the mesh that lies in the grid. A pair of a triangle and a voxel that it covers is a
// fragment.
struct Surface {
  double fragments = 0;      // under the request's coverage
  double rows = 0;           // runs of a triangle's fragments along x within a tile
  double pairs = 0;          // of a triangle and a tile of 32x8x8 voxels
  double voxels = 0;         // that are covered
  double bricks = 0;         // of 8x8x8 voxels that are touched
  double tiles = 0;          // likewise
  double layers = 0;         // of voxels, of each triangle those that it touches
  double crossings = 0;      // of lines along x through voxel centres
  double inside = 0;         // voxels that a fill adds, and ...
  double filled_bricks = 0;  // ... bricks that are touched then
  // How many of the fragments and bricks lie in each `share_layers` layers. Empty: spread evenly.
  struct Share {
    double fragments = 0, bricks = 0;
  };
  int64_t share_layers = 8;
  std::vector<Share> shares;
  bool closely = false;  // the triangles were clipped to the grid: Stages::Measure has nothing better to say
  // Of a sample: lists may come to be so many times as long. A plan that fits only if they do not is made closely.
  double doubt = 1;
};

// From the sums of mesh.extent or, where there are none, from its box: what is said without a look at the triangles. No
// triangle counts for more than the grid's own sections. Sums made without a window, and boxes, count as if all of the
// mesh lay in the grid.
Surface EstimateSurface(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh);

// About what a measurement of the grid `to` would say, without a look at the triangles. In: the surface of the grid
// `from`, which has the same place in voxels of another size; triangles of the mesh. The nearer the two sizes are, the
// more exact it is.
Surface RescaleSurface(const Surface& surface, const VoxelizeRequest& request, const GridSpec& from, const GridSpec& to,
                       uint64_t triangles);

// The most that any slab of `layers` layers has of the surface.
Surface MostOfSlab(const Surface& surface, const GridSpec& grid, int64_t layers);

}  // namespace voxelpipe
