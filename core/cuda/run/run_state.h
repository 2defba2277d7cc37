// What the stages of one run on a CUDA device share, in the order in which they make it. It holds a
// cpu::RunState, whose views show the mesh on the host.
//
// Every function that takes a RunState gives its work to state.stream. None synchronizes unless its comment says so.
#pragma once

#include <cuda_runtime_api.h>

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "cpu/run_state.h"
#include "cuda/device/buffer.h"
#include "cuda/device/check.h"
#include "cuda/device/device.h"
#include "cuda/device/graph_cache.h"
#include "cuda/device/mesh_cache.h"
#include "cuda/device/pinned.h"
#include "cuda/device/run_memory.h"
#include "cuda/plan/path_plan.h"
#include "cuda/primitives/views.h"
#include "cuda/run/counters.h"
#include "cuda/run/device_mesh.h"
#include "cuda/run/slab_state.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe::cuda {

struct RunState {
  RunState(const TriangleMesh& m, const BoundRequest& r, const JobContext& j) : request(r), job(j), host(m, r, j) {}

  RunMemory memory;  // before all arrays, which it counts
  const BoundRequest& request;
  const JobContext& job;
  DeviceInfo device;
  cudaStream_t stream = nullptr;
  LaunchGraphs graphs;
  // What the stream's work reads: released when it is done.
  std::vector<PinnedBuffer> staged;
  std::vector<std::shared_ptr<const CachedArray>> cached;

  // VertexShade
  cpu::RunState host;  // its view shows the mesh before the vertex shader
  DeviceMesh mesh;
  Box3d box;                  // of the vertices that triangles use, world space
  bool shaded_there = false;  // the shader placed vertices, and the host does not know where

  // What the plan expects the mesh to touch of the whole grid: lists are made room for by it before they are counted.
  Surface expected;

  // SetUpGrid: of the whole grid
  GridSpec grid;
  GridView view{};      // dims, tiles, slab: what kernels get
  bool placed = false;  // whether index_positions and codes are made
  PathInputs path_inputs;
  PathPlan plan;
  DeviceArray<uint64_t> counters;  // see Counter
  DeviceArray<uint8_t> scratch;    // of CUB
  DeviceArray<uint32_t> queue[3];  // triangles that wait for another kernel of a stage
  std::optional<bool> scattered;   // see IsScattered
  std::optional<bool> by_rows;     // see ManyGoByRows
  ScatteredMesh scattered_mesh;

  // BeginSlab: what follows holds the slab's layers only
  Slab slab;
  std::array<int64_t, 3> slab_dims{1, 1, 1};
  TargetViews targets{};
  std::array<TargetMemory, kMaxTargets> target_memory;
  DeviceArray<uint32_t> bit_pool;  // of plain bits (bit_bricks.h)
  DeviceArray<uint32_t> coverage;  // bit grid: voxels that a fragment of any target wrote
  DeviceResult result;             // sparse, buckets

  CoverageLists lists;
  FragmentState a_buffer;  // buckets
  BrickState sparse;
  OwnerList owners;
  std::array<SpanTarget, kMaxTargets> span_targets;

  // FineRaster, SolidFill
  DeviceArray<uint32_t> inside, outside;  // bit grids; outside is of the whole grid
  SlabCounts counts;                      // up to date after Counts

  uint64_t slab_rows() const { return uint64_t(slab_dims[1]) * uint64_t(slab_dims[2]); }
  uint64_t slab_words() const { return slab_rows() * uint64_t(view.words_per_row); }
  uint64_t slab_voxels() const { return slab_rows() * uint64_t(slab_dims[0]); }
};

// Whether no voxel is covered, so that there are no fragments.
inline bool CoversNothing(const RunState& state) {
  return state.request.request.coverage == Coverage::kNone;
}

// The bit grid of voxels that some triangle touches; the coverage, unless all targets can discard.
inline uint32_t* TouchedBits(RunState& state) {
  return state.lists.touched_bits.empty() ? state.coverage.data() : state.lists.touched_bits.data();
}

// Allocates the counters, all 0, before their first use.
absl::Status EnsureCounters(RunState& state);
// Sets counters to 0.
absl::Status ClearCounters(RunState& state, std::initializer_list<Counter> which);
// Likewise those of the queues and of the list, and what stands behind the counters up to `end`.
absl::Status ClearQueues(RunState& state, int end);
// Copies all counters to the host. Synchronizes with the stream.
absl::StatusOr<std::array<uint64_t, kCounters>> ReadCounters(RunState& state);

// The stages; see pipeline/stages/stages.h for what each does.
absl::StatusOr<MeshExtent> VertexShade(RunState& state);
absl::Status PlaceVertices(RunState& state);  // unless they are placed
absl::Status SetUpGrid(RunState& state, const GridSpec& grid);
absl::Status BeginSlab(RunState& state, const Slab& slab);
void AbandonSlab(RunState& state);  // synchronizes
absl::Status FineRaster(RunState& state);
absl::Status SolidFill(RunState& state);      // flood: synchronizes
absl::Status EmitFragments(RunState& state);  // synchronizes
absl::Status SortFragments(RunState& state);  // may synchronize
absl::Status Resolve(RunState& state);        // counters[kBuckets] becomes the number of voxels that are listed
absl::Status MakeBricks(RunState& state);     // sparse: state.result; synchronizes
absl::StatusOr<ResultArrays> Finish(RunState& state);  // copies to the host; synchronizes

// Whether any fragment shader looks at more than which voxels a triangle touches.
bool AnyShading(const BoundRequest& request);
// Whether an A-buffer's targets show more than which fragments there are; only then do its shaders run.
bool ShadesFragments(const BoundRequest& request);
// A dense target's clear value as a repeated word.
uint32_t PatternOf(const CudaTarget& target);
// The target of a request, without memory.
CudaTarget DescribeTarget(const TargetSpec& spec, const BoundShader& shader);
// Makes state.targets, without memory; after VertexShade.
void DescribeTargets(RunState& state);
// What the plan of a grid depends on; after DescribeTargets.
PathInputs PathInputsOf(const RunState& state, const GridSpec& grid);

// A mesh of so many triangles keeps the device busy with some a thread; and whether the run's is such.
uint64_t FineTriangles(const DeviceInfo& device);
bool IsFine(const RunState& state);

// Parts of stages
absl::Status BlendDirectly(RunState& state);  // synchronizes, but for a sparse result
// What was blended becomes the values of a sparse result, whose voxels are listed.
absl::Status StoreListed(RunState& state);
// Sets the bits of layers [z_begin, z_end) that triangles touch in a bit grid of `words` words, which it clears first.
absl::Status RasterRows(RunState& state, Coverage coverage, int64_t z_begin, int64_t z_end, uint32_t* bits,
                        uint64_t words);
absl::Status ParityInside(RunState& state);
absl::Status NonzeroInside(RunState& state);
absl::Status FloodInside(RunState& state);
// Adds the set bits of `a`, or of `a` and `b` together, to a counter. `b` may be null.
absl::Status CountBits(RunState& state, const uint32_t* a, const uint32_t* b, uint64_t words, Counter counter);
absl::Status CountSlab(RunState& state);  // kVoxels; BeginSlab cleared the other counters of the slab

}  // namespace voxelpipe::cuda
