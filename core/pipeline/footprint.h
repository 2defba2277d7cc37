// The memory that a run takes, predicted.
#pragma once

#include <cstdint>

#include "grid/grid_spec.h"
#include "pipeline/plan.h"
#include "pipeline/request.h"

namespace voxelpipe {

struct MeshSize {
  uint64_t triangles = 0, vertices = 0;
  MeshExtent extent;
};

struct Footprint {
  uint64_t result_bytes = 0;  // of all arrays together
  uint64_t peak_bytes = 0;    // working set, what is held of the result included, the mesh excluded
  int64_t slab_depth = 1;     // layers worked on at a time
};

// In: a valid request, the grid it is fitted to, the mesh after its vertex shader; whether the CUDA backend runs it, whose lists of
// triangles, spans and fragments then count too. Out: what the run takes, on the CPU within a factor of
// 1.5 of what is measured (tests/unit/pipeline/plan_memory_test.cpp) for surfaces that are neither folded within a voxel nor, with a
// fill into a sparse result, turned both outwards and inwards.
Footprint PredictFootprint(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                           const PlanLimits& limits, Delivery delivery, bool cuda = false);

// Bytes of device memory that a slab of so many layers takes on the CUDA backend besides the mesh: a prediction, as above.
uint64_t PredictSlabBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh, int64_t layers);

// In: the layers a slab that the plan has, and the bytes of device memory there are. Out: no more layers, a multiple of the granularity unless
// they are all, for which the prediction leaves room, but at least one slab's granularity. Where slabs are cut for want of room, those of dense
// results take no more than kMostSlabBytes each: so much is copied through pinned memory at a time.
inline constexpr uint64_t kMostSlabBytes = 1 << 30;
int64_t FittingSlabDepth(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh, int64_t depth,
                         uint64_t room);

}  // namespace voxelpipe
