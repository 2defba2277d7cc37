// The memory that a run takes, predicted.
#pragma once

#include <algorithm>
#include <cstdint>

#include "grid/grid_spec.h"
#include "job/request.h"
#include "pipeline/plan/plan.h"
#include "pipeline/plan/surface.h"

namespace voxelpipe {

struct Footprint {
  uint64_t result_bytes = 0;  // of all arrays together
  uint64_t peak_bytes = 0;    // working set, what is held of the result included, the mesh excluded
  int64_t slab_depth = 1;     // layers worked on at a time
  // The part of peak_bytes that lists take whose lengths are estimates: a run that comes to need more takes it from the
  // job's budget as it counts (pipeline/plan/list_memory.h).
  uint64_t list_bytes = 0;
};

// Bytes of a dense result, which follow from the grid alone; 0 of other results.
uint64_t DenseResultBytes(const VoxelizeRequest& request, const GridSpec& grid);

// In: a valid request, the grid it is fitted to, the mesh after its vertex shader and what it touches of the grid. Out:
// what the run takes of the host's memory on the CPU backend. tests/property/plan_bounds.cpp compares it with what
// allocators count.
Footprint PredictHostFootprint(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                               const Surface& surface, const PlanLimits& limits, Delivery delivery);

// The same of the CUDA backend: of the host's memory and the device's together, whose lists of triangles, spans and
// fragments then count too.
Footprint PredictDeviceFootprint(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                                 const Surface& surface, const PlanLimits& limits, Delivery delivery);

// Bytes of device memory that a slab of so many layers takes on the CUDA backend besides the mesh: a prediction, as above.
uint64_t PredictSlabBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                          const Surface& surface, int64_t layers);

// Fragments that the CUDA backend makes room for before it has counted those of a slab: more than are expected, so that
// it seldom has to list them again.
inline uint64_t FragmentRoom(const Surface& slab) {
  constexpr double kMore = 1.25;
  constexpr uint64_t kAnyway = 1 << 16;
  return uint64_t(std::min(kMore * slab.fragments, 0x1p62)) + kAnyway;
}

// In: the layers a slab that the plan has, and the bytes of device memory there are. Out: no more layers, a multiple of
// the granularity unless they are all, for which the prediction leaves room, but at least one slab's granularity. Where
// slabs are cut for want of room, those of dense results take no more than kMaxSlabBytes each: so much is copied
// through pinned memory at a time.
inline constexpr uint64_t kMaxSlabBytes = 1 << 30;
int64_t FittingSlabDepth(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                         const Surface& surface, int64_t depth, uint64_t room);

}  // namespace voxelpipe
