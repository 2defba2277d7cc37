// What a mesh touches of a grid: the numbers that a run's memory follows from.
#pragma once

#include <cstdint>
#include <vector>

#include "grid/grid_spec.h"
#include "pipeline/request.h"

namespace voxelpipe {

// Where a shaded mesh lies and how large its surface is, in world units.
struct MeshExtent {
  Box3d box;                  // of the vertices that triangles use
  uint64_t shaded_bytes = 0;  // what the vertex shader made of the vertices; 0 where it left them alone, or did not run
  // Sums over the triangles, 0 where they were not made. Stages that look at the triangles again once the grid is known
  // (Stages::Measure) leave them out.
  Vec3d projected_area{};  // onto the planes orthogonal to x, y, z
  Vec3d dominant_area{};   // the same, of each triangle only the largest of the three
  Vec3d width{};           // extents of each triangle's box along x, y, z
  double volume =
      0;  // signed, between the triangles and the centre of `box`: the enclosed one where the mesh is closed
};

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
};

// From the sums of mesh.extent or, where there are none, from its box: what is said without a look at the triangles. No
// triangle counts for more than the grid's own sections; those beyond the grid count as if they lay in it.
Surface EstimateSurface(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh);

// The most that any slab of `layers` layers has of the surface.
Surface MostOfSlab(const Surface& surface, const GridSpec& grid, int64_t layers);

}  // namespace voxelpipe
