// Properties of every run, checked against references independent of the product.
#pragma once

#include <string>
#include <vector>

#include "fuzz/fuzz_case.h"
#include "job/result.h"

namespace voxelpipe::fuzz {

// Runs a case on every path of the pipeline and compares:
//    the coverage with polygon clipping in long double, the fills with plain loops (parity, nonzero) and a queue
// (flood);
//   dense values with clear, fill and the blends of the bucket's fragments; sparse and buckets with dense;
//   the bytes of every instruction set, of 1 and 2 threads, of slabs and of one piece, streamed and in memory, and of
//   the triangles the other way round where order must not matter.
// Out: the differences; empty if there are none.
std::string CheckCase(const FuzzCase& made);

// ---- its parts; each appends to the differences ----

// Index-space vertices of each triangle.
struct IndexTriangle {
  Vec3d v[3];
};
std::vector<IndexTriangle> IndexTriangles(const TriangleMesh& mesh, const GridSpec& grid);

// One byte a voxel, 0 or 1.
using VoxelFlags = std::vector<uint8_t>;
VoxelFlags Flags(const HostBuffer& bits, uint64_t voxels);

std::string CheckCoverage(const std::vector<IndexTriangle>& triangles, const GridSpec& grid, Coverage coverage,
                          const VoxelFlags& covered);
// `filled` is the result with the fill; `shell` the conservative coverage.
std::string CheckCrossings(Fill fill, const std::vector<IndexTriangle>& triangles, const GridSpec& grid,
                           const VoxelFlags& covered, const VoxelFlags& filled, uint64_t odd_columns);
std::string CheckFlood(const GridSpec& grid, const VoxelFlags& shell, const VoxelFlags& covered,
                       const VoxelFlags& filled);

// `sparse` lists the voxels of `occupied` (null: not checked) with the values of `dense`; elsewhere `dense` is clear.
std::string CheckSparse(const VoxelizeResult& sparse, const VoxelizeResult& dense, const VoxelFlags* occupied);
// The lists are in order and hold the fragments that `counts` says, of triangles that touch their voxels.
std::string CheckBuckets(const VoxelizeResult& buckets, const VoxelizeResult& counts,
                         const std::vector<IndexTriangle>& triangles, Coverage coverage);
// `dense` holds the blends of the fragments of `buckets` (null: there are no fragments), what `request` fills with
// where only `filled`, else clear.
std::string CheckValues(const VoxelizeRequest& request, const VoxelizeResult& dense, const VoxelizeResult* buckets,
                        const VoxelFlags& filled);

}  // namespace voxelpipe::fuzz
