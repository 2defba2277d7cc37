// Which kernels set the bits of a run that asks for occupancy alone, or of a fill's shell. A pure function, tested
// without a GPU. No host-only includes but the standard library's, no CUDA headers.
#pragma once

#include <array>
#include <cstdint>
#include <functional>

namespace voxelpipe::cuda {

enum class OccupancyPath : uint8_t {
  kClear,         // there are no triangles
  kBlocks,        // few triangles in a grid beyond the cache: sorted into blocks of the grid, each stored once
  kSingleLaunch,  // a mesh so small that one cooperative kernel does all steps
  kBricks,        // bricks that are allocated meanwhile, for a grid far beyond the cache
  kRows,          // a thread per triangle, and the rows of its warp's triangles shared
  kResident,      // a thread or two per triangle, all of them resident at once
  kTriangles,     // a thread per triangle
};

struct OccupancyInputs {
  std::array<int64_t, 3> dims{1, 1, 1};  // of the slab
  uint64_t bytes = 0;                    // of its bit grid
  uint64_t triangles = 0;
  bool alone = true;        // the run makes nothing else; a fill's shell takes the last three paths only
  bool fixed_point = true;  // fixed point decides what most triangles touch
  // Asked only if the answer matters. True if the mesh is unordered, and a copy of it in spatial order is there.
  std::function<bool()> has_ordered_copy = [] { return false; };
  // True if enough triangles take several rows.
  std::function<bool()> needs_rows = [] { return false; };
  // Of the device. 0: unknown, and no grid exceeds it.
  uint64_t cache_bytes = 0;
  uint64_t single_launch_triangles = 0;  // the most of OccupancyPath::kSingleLaunch
  uint64_t resident_triangles = 0;       // the most of OccupancyPath::kResident, one thread each
  uint64_t kernel_clear_bytes = 0;       // grids up to this size are cleared by the kernel that sets bits
  // Paths whose arrays found no memory.
  bool without_blocks = false, without_bricks = false;
};

struct OccupancyPlan {
  OccupancyPath path = OccupancyPath::kTriangles;
  bool keeps_together = false;    // few triangles in flight, so that concurrent writes lie close to each other
  bool draws_largest = false;     // the largest triangles are drawn while the grid is cleared
  bool clears_in_kernel = false;  // the first blocks of the kernel clear the grid
  int lanes_per_triangle = 0;     // kResident
  bool rows_together = false;     // kRows: a warp merges the bits of its rows before it writes them
};

OccupancyPlan PlanOccupancy(const OccupancyInputs& in);

}  // namespace voxelpipe::cuda
