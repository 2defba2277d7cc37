// The memory that a run takes on a CUDA device and of the host, predicted. No CUDA headers: the prediction is compiled
// and tested without nvcc.
#pragma once

#include <cstdint>

#include "pipeline/plan/footprint.h"
#include "pipeline/plan/plan.h"
#include "pipeline/plan/surface.h"

namespace voxelpipe::cuda {

// Backend::Predict (pipeline/stages/stages.h): of the host's memory and the device's together.
Footprint PredictFootprint(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                           const Surface& surface, const PlanLimits& limits, Delivery delivery);

// Bytes of the lists that the stages make on the device, of a surface in `layers` layers.
double DeviceListBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                       const Surface& surface, int64_t layers);

// Bytes of device memory that a slab of `layers` layers takes besides the mesh.
uint64_t PredictSlabBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                          const Surface& surface, int64_t layers);

// Where slabs are cut for want of memory, a dense one has at most so many bytes: it is copied through pinned memory.
inline constexpr uint64_t kMaxSlabBytes = 1 << 30;

// In: `depth`, the plan's layers of a slab, and `free_bytes` of device memory. Out: the layers of a slab for which the
// prediction leaves room, at most `depth`, a multiple of kSlabGranularity unless it is `depth`, at least
// kSlabGranularity.
int64_t FittingSlabDepth(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                         const Surface& surface, int64_t depth, uint64_t free_bytes);

}  // namespace voxelpipe::cuda
