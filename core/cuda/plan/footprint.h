// Predicts the device and host memory of a run. No CUDA headers: compiled and tested without nvcc.
#pragma once

#include <cstdint>

#include "pipeline/plan/footprint.h"
#include "pipeline/plan/plan.h"
#include "pipeline/plan/surface.h"

namespace voxelpipe::cuda {

// Implements Backend::Predict (pipeline/stages/stages.h): host and device memory together.
Footprint PredictFootprint(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                           const Surface& surface, const PlanLimits& limits, Delivery delivery);

// Device bytes of the lists made by the stages, for a surface within `layers` layers.
double DeviceListBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                       const Surface& surface, int64_t layers);

// Device bytes of a slab of `layers` layers besides the mesh.
uint64_t PredictSlabBytes(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                          const Surface& surface, int64_t layers);

// Maximum bytes of a dense slab if memory forces several slabs: slabs are copied through pinned memory.
inline constexpr uint64_t kMaxSlabBytes = 1 << 30;

// `depth`: the plan's layers per slab; `free_bytes`: of device memory. Returns the layers per slab whose prediction
// fits: at most `depth`, a multiple of kSlabGranularity unless it is `depth`, at least kSlabGranularity.
int64_t FittingSlabDepth(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                         const Surface& surface, int64_t depth, uint64_t free_bytes);

}  // namespace voxelpipe::cuda
