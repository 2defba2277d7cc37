// OpenVDB's meshToVolume, for comparison.
#pragma once

#include <cstdint>
#include <optional>

#include "grid/grid_spec.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe::bench {

struct PeerRun {
  double wall_ms = 0;
  double cpu_ms = 0;    // of the whole process
  uint64_t voxels = 0;  // active ones
};

// In: a mesh, the grid of its index space, the threads that oneTBB may use (>= 1). Out: the time that
// openvdb::tools::meshToVolume (K. Museth, "VDB: High-Resolution Sparse Volumes with Dynamic Topology", 2013) takes for
// an unsigned distance field in a band of one voxel to either side of the surface, from index-space vertices in memory
// to its grid. It is OpenVDB's least work that marks every voxel near the surface: a signed field sweeps once more.
// Empty if the benchmarks were built without OpenVDB.
std::optional<PeerRun> RunOpenVdb(const TriangleMesh& mesh, const GridSpec& grid, int threads);

}  // namespace voxelpipe::bench
