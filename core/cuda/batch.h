// One pass of the device for many meshes.
//
// Source: J. Pantaleoni, "VoxelPipe", HPG 2011, voxelizes one mesh a call; here the grids of many small jobs share one index space, so
// that a batch costs one upload, one set of launches and one copy back.
#pragma once

#include <span>
#include <vector>

#include "cuda/batch_views.h"
#include "cuda/buffer.h"
#include "cuda/device.h"
#include "pipeline/batch.h"

namespace voxelpipe::cuda {

struct BatchState {
  DeviceInfo device;
  cudaStream_t stream = nullptr;
  BatchView view;
};

// Backend::RunShared, inside the backend's arena. Which items can share a pass: dense and small sparse results of plain bits, without or
// with parity fill, that are not large (batch.cpp).
std::vector<size_t> RunShared(const Backend& backend, const DeviceInfo& device, std::span<const BatchItem> items,
                              const PlanLimits& limits, BatchStats& stats);

// The steps of a pass, in this order. None synchronizes.
absl::Status RasterBatch(const BatchState& state);  // row_bits.cu: coverage
absl::Status FillBatch(const BatchState& state);    // solid_fill.cu: inside, odd columns
absl::Status PackBatch(const BatchState& state);    // targets.cu: occupied voxels, packed targets

}  // namespace voxelpipe::cuda
