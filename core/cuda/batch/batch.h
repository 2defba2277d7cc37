// Voxelizes many small meshes in one pass of the device.
//
// Source: J. Pantaleoni, "VoxelPipe", HPG 2011, voxelizes one mesh per call. Here the grids of many small jobs share
// one index space, so that a batch costs one upload, one set of launches and one readback. A-buffers add a constant
// number of each.
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
  // A-buffers: voxels have numbers over all A-buffers, triangles have their numbers within their mesh.
  uint32_t first_bucketed = 0;  // first A-buffer item; the last item is one too
  bool drops = false;           // some of their fragments may be discarded
  Fragments fragments;
  DeviceArray<uint64_t> chunks;  // per chunk of sorted fragments (SortedKeys::first)
  DeviceArray<uint8_t> scratch;
};

// Implements Backend::RunShared, inside the backend's arena. Items can share a pass if they are small: dense and sparse
// results with any fill, and A-buffers (limits: batch_member.cpp).
std::vector<size_t> RunShared(const Backend& backend, const DeviceInfo& device, std::span<const BatchItem> items,
                              const PlanLimits& limits, BatchStats& stats);

// The steps of a pass, in this order. None synchronizes unless its comment says so.
absl::Status RasterBatch(const BatchState& state);  // batch_bits.cu: transforms vertices; rasterizes occupancy bits
absl::Status ClearBatch(const BatchState& state);   // batch_targets.cu: clears the values of the other items
// BatchValues::Make: their coverage and values.
absl::Status FloodBatch(const BatchState& state);  // batch_flood.cu: inside voxels of items with flood fill
absl::Status FillBatch(const BatchState& state);   // batch_fill.cu: parity fill, odd columns, values of filled voxels
absl::Status PackBatch(const BatchState& state);   // batch_targets.cu: counts occupied voxels, packs targets
// batch_fragments.cu, if there are A-buffers:
absl::Status EmitBatch(BatchState& state);  // emits fragments; synchronizes
// Sorts the fragments. Returns the first fragment of each item, the end of the last one (discarded fragments lie behind
// it), and the number of voxels, in which all discarded fragments count as one. Synchronizes.
absl::StatusOr<std::vector<uint64_t>> SortBatch(BatchState& state);
// Outputs voxel numbers and the offset of each voxel's fragments, followed by the end offset.
absl::Status ListBatch(BatchState& state, uint32_t* voxels, uint32_t* offsets);
absl::Status ShadeBatch(BatchState& state, BatchShadeArgs args);  // `args` without keys and triangles

// Triangles [first, first + count) of a batch, and the number of fragments of each, followed by a 0. They were counted
// by a traversal with the counters of `queue`.
struct BatchTriangles {
  uint64_t first = 0, count = 0;
  BatchQueue queue{};
  uint32_t* fragments = nullptr;
};
// Prefix sum: firsts[t] is the offset of triangle t's fragments in the list; one more element is the end.
absl::Status FindFirsts(BatchState& state, const BatchTriangles& of, DeviceArray<uint64_t>& firsts);
// Writes these fragments: voxels numbered over all items, triangles within their mesh. Overwrites the counts.
absl::Status EmitList(BatchState& state, const BatchTriangles& of, const uint64_t* firsts, uint32_t* keys,
                      uint32_t* triangles);

}  // namespace voxelpipe::cuda
