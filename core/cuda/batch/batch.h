// One pass of the device for many meshes.
//
// Source: J. Pantaleoni, "VoxelPipe", HPG 2011, voxelizes one mesh a call; here the grids of many small jobs share one
// index space, so that a batch costs one upload, one set of launches and one copy back; A-buffers add a few of each,
// however many they are.
#pragma once

#include <span>
#include <vector>

#include "cuda/batch/batch_views.h"
#include "cuda/device/buffer.h"
#include "cuda/device/device.h"
#include "cuda/run/fragment_list.h"
#include "pipeline/batch.h"

namespace voxelpipe::cuda {

struct BatchState {
  DeviceInfo device;
  cudaStream_t stream = nullptr;
  BatchView view;
  // Of A-buffers: voxels are numbered as among all of them, triangles as in their meshes.
  uint32_t first_bucketed = 0;  // item; they end with the last one
  bool drops = false;           // some of their fragments may be dropped
  Fragments fragments;
  DeviceArray<uint64_t> chunks;  // of sorted fragments (SortedKeys::first)
  DeviceArray<uint8_t> scratch;
};

// Backend::RunShared, inside the backend's arena. Which items can share a pass: dense and small sparse results,
// whatever their fill, and A-buffers, that are not large (batch_member.cpp).
std::vector<size_t> RunShared(const Backend& backend, const DeviceInfo& device, std::span<const BatchItem> items,
                              const PlanLimits& limits, BatchStats& stats);

// The steps of a pass, in this order. None synchronizes unless its comment says so.
absl::Status RasterBatch(const BatchState& state);  // batch_bits.cu: places vertices; coverage of plain bits
absl::Status ClearBatch(const BatchState& state);   // batch_targets.cu: values of the other items
// BatchValues::Make: their coverage and values.
absl::Status FloodBatch(const BatchState& state);  // batch_flood.cu: inside of items with flood fill
absl::Status FillBatch(const BatchState& state);   // batch_fill.cu: inside of the others, odd columns, filled values
absl::Status PackBatch(const BatchState& state);   // batch_targets.cu: occupied voxels, packed targets
// batch_fragments.cu, of A-buffers where there are any:
absl::Status EmitBatch(BatchState& state);  // fragments; synchronizes
// Sorts them, where there are any. Out: where each item's begin; where the last one's end, behind which those that are
// dropped lie; and how many voxels there are, one of dropped fragments among them. Synchronizes.
absl::StatusOr<std::vector<uint64_t>> SortBatch(BatchState& state);
// Numbers of voxels and where their fragments begin; behind the last one's stands where they end.
absl::Status ListBatch(BatchState& state, uint32_t* voxels, uint32_t* offsets);
absl::Status ShadeBatch(BatchState& state, BatchShadeArgs args);  // `args` but for keys and triangles

// Triangles [first, first + count) of a batch, and how many fragments each has, with one more that stays 0: what a walk
// with the counters of `queue` has counted.
struct BatchTriangles {
  uint64_t first = 0, count = 0;
  BatchQueue queue{};
  uint32_t* fragments = nullptr;
};
// firsts[t], of a triangle and of the end: where its fragments begin in a list of those of all triangles before it.
absl::Status FindFirsts(BatchState& state, const BatchTriangles& of, DeviceArray<uint64_t>& firsts);
// Writes these fragments: voxels among those of all items, triangles as in their meshes. The counts become others.
absl::Status EmitList(BatchState& state, const BatchTriangles& of, const uint64_t* firsts, uint32_t* keys,
                      uint32_t* triangles);

}  // namespace voxelpipe::cuda
