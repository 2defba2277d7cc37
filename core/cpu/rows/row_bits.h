// The path for occupancy bits alone: row spans straight into the bit grid, without tiles.
//
// Occupancy needs no blending, so sorting into tiles would not pay. Bits are set in the grid itself, atomically where
// several threads work; on fine meshes most of them are set already. Only triangles of many rows are binned, to slabs
// of a few layers. Where the voxels of parts are counted all triangles are, and a slab takes its parts one by one.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "cpu/rows/row_kernels.h"
#include "grid/bit_grid.h"
#include "grid/grid_spec.h"
#include "mesh/views/mesh_view.h"

namespace voxelpipe::cpu {

class RowBits {
 public:
  RowBits(const RowKernels& kernels, const MeshView& mesh, const GridSpec& grid, Coverage coverage);
  ~RowBits();

  // Finds the voxels that each vertex touches. Keeps the vertices in index space if requested. OUT_OF_RANGE if a vertex
  // that a triangle uses is beyond 2^40 voxels; CANCELLED, DEADLINE_EXCEEDED.
  absl::Status Place(bool keep_positions, const JobContext& job);

  // Sets `bits`, the grid's layers [begin, end), to the coverage; `bits` need not be cleared. After Place; any layers,
  // any number of times.
  absl::Status Raster(int64_t begin, int64_t end, BitGrid& bits, const JobContext& job) const;

  // The same of a mesh whose runs are ordered by rank (host_mesh/order_parts.h), and counts the voxels that each part
  // owns. In: of each voxel of these layers, x fastest, the rank plus 1 of the highest part around its centre, 0 where
  // there is none. A part takes a covered voxel from parts of lower ranks that cover it or contain its centre. Adds to
  // `voxels`, by rank, the difference to the numbers of voxels in `inside`.
  absl::Status RasterParts(int64_t begin, int64_t end, BitGrid& bits, const uint16_t* inside,
                           std::vector<int64_t>& voxels, const JobContext& job) const;

  // All vertices in index space; null unless kept. After Place.
  const Vec3d* index_positions() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace voxelpipe::cpu
