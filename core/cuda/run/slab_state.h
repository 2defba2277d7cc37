// Arrays of the slab at work, a struct for the stages that share them.
#pragma once

#include <vector>

#include "cuda/device/buffer.h"
#include "cuda/primitives/flat_shading.h"
#include "cuda/run/fragment_list.h"
#include "raster/degenerate.h"

namespace voxelpipe::cuda {

// Device memory behind the views of one CudaTarget.
struct TargetMemory {
  DeviceArray<uint32_t> bits, presence;
  DeviceArray<uint8_t> dense;
};

// State of a target in scatter blending (blend_spans.cuh).
struct SpanTarget {
  DeviceArray<uint32_t> values, negative;  // per triangle
  DeviceArray<int64_t> terms;
  DeviceArray<uint32_t> cells, counts;  // accumulators, by voxel rank
  DeviceArray<unsigned long long> sums;
  bool shaded = false;  // values or terms are computed
  bool by_id = false;   // neither exists: the value is the triangle's id
  FlatShading shading;
  DegenerateTest degenerate;  // for the run's triangles
};

// Owner list of a target: voxels within the slab, triangles, and output elements.
struct OwnerList {
  DeviceArray<uint32_t> keys, triangles, to;

  void Free() {
    for (auto* array : {&keys, &triangles, &to}) array->Free();
  }
};

// A brick pool (brick_scatter.cuh): arrays per brick of the slab and per slot of the pool.
struct PoolMemory {
  DeviceArray<uint32_t> places, cells, masks, bricks, voxels;

  void Free() {
    for (auto* array : {&places, &cells, &masks, &bricks, &voxels}) array->Free();
  }
};

// Arrays of a sparse or bucketed result on the device, in the form of ResultArrays. The triangles of buckets are in
// RunState::a_buffer.
struct DeviceResult {
  DeviceArray<uint64_t> bricks, voxels, offsets;
  DeviceArray<uint8_t> masks;
  std::vector<DeviceArray<uint8_t>> targets;
  // Known to the host; the number of voxels of buckets only after the slab's counters are read.
  uint64_t listed_bricks = 0, listed_voxels = 0, listed_fragments = 0;
};

// What the coverage pass finds (coverage/): records per triangle, in the order in which it takes them, and spans.
struct CoverageLists {
  DeviceArray<uint64_t> cells, blocks;  // coverage_record.h
  DeviceArray<uint64_t> spans;          // span.h; in no order, kNoSpan among them
  uint64_t span_count = 0;              // of all triangles, including those beyond the list's capacity
  // Bit grid: voxels that triangles touch, including those of discarded fragments; empty: the coverage has all.
  DeviceArray<uint32_t> touched_bits;
  DeviceArray<uint32_t> word_ranks;  // per word of it, or of the coverage if it is empty (Ranks)
  uint64_t ranked_voxels = 0;        // those with accumulators

  void Free() {
    for (auto* array : {&cells, &blocks, &spans}) array->Free();
    for (auto* array : {&touched_bits, &word_ranks}) array->Free();
  }
};

// The A-buffer between EmitFragments and Resolve.
struct FragmentState {
  Fragments fragments;                   // keys are voxel indices within the slab
  DeviceArray<uint64_t> fragment_first;  // how many fragments each chunk of records has (FragmentCounts)
  DeviceArray<uint64_t> bucket_chunks;   // for CountAndListBuckets and UnpackIntoBuckets: 0 once fragments are emitted
  DeviceArray<uint64_t> bundles_before;  // for EmitBundles: per block of it

  void Free() {
    fragments.Free();
    for (auto* array : {&fragment_first, &bucket_chunks, &bundles_before}) array->Free();
  }
};

// Bricks of a sparse result.
struct BrickState {
  DeviceArray<uint32_t> brick_counts, voxel_counts;  // per tile of four bricks, and one more
  DeviceArray<uint64_t> first_brick, first_voxel;
  DeviceArray<uint32_t> listed_bits;  // the bit of each listed voxel in the bit grid
  PoolMemory pool;                    // Path::kBricks

  void Free() {
    for (auto* array : {&brick_counts, &voxel_counts, &listed_bits}) array->Free();
    for (auto* array : {&first_brick, &first_voxel}) array->Free();
    pool.Free();
  }
};

}  // namespace voxelpipe::cuda
