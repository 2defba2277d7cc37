// State of one run on a CUDA device, shared by its stages, in the order in which they fill it. Contains a
// HostMesh, whose views show the mesh on the host.
//
// Functions that take a RunState queue their work on state.stream. None synchronizes unless its comment says so.
#pragma once

#include <cuda_runtime_api.h>

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

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
#include "cuda/run/part_state.h"
#include "cuda/run/slab_state.h"
#include "host_mesh/host_mesh.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe::cuda {

struct RunState {
  RunState(const TriangleMesh& m, const BoundRequest& r, const JobContext& j) : request(r), job(j), host(m, r, j) {}

  RunMemory memory;  // before all arrays, because it accounts for them
  const BoundRequest& request;
  const JobContext& job;
  DeviceInfo device;
  cudaStream_t stream = nullptr;
  LaunchGraphs graphs;
  // Read by queued work: released when the stream is done.
  std::vector<PinnedBuffer> staged;
  std::vector<std::shared_ptr<const CachedArray>> cached;

  // VertexShade
  HostMesh host;  // its view shows the mesh before the vertex shader
  DeviceMesh mesh;
  Box3d box;                  // world-space bounds of the vertices that triangles use
  bool shaded_there = false;  // vertices were shaded on the device; the host has no positions

  // Predicted voxels and fragments of the whole grid: list capacities depend on it before exact counts are known.
  Surface expected;

  // SetUpGrid: of the whole grid
  GridSpec grid;
  GridView view{};      // dimensions, tiles and slab, for kernels
  bool placed = false;  // index_positions and codes are computed
  PathInputs path_inputs;
  PathPlan plan;
  DeviceArray<uint64_t> counters;  // indexed by Counter
  DeviceArray<uint8_t> scratch;    // temporary storage of CUB
  DeviceArray<uint32_t> queue[3];  // triangles deferred to another kernel of a stage
  std::optional<bool> scattered;   // see IsScattered
  std::optional<bool> by_rows;     // see ManyGoByRows
  ScatteredMesh scattered_mesh;

  // BeginSlab: the members below hold the slab's layers only
  Slab slab;
  std::array<int64_t, 3> slab_dims{1, 1, 1};
  TargetViews targets{};
  std::array<TargetMemory, kMaxTargets> target_memory;
  DeviceArray<uint32_t> bit_pool;  // of occupancy bits (bit_bricks.h)
  DeviceArray<uint32_t> coverage;  // bit grid: voxels with a fragment in any target
  DeviceResult result;             // sparse and bucketed results

  CoverageLists lists;
  FragmentState a_buffer;  // bucketed results
  BrickState sparse;
  OwnerList owners;
  std::array<SpanTarget, kMaxTargets> span_targets;

  PartState parts;  // VertexShade, FindOwners

  // FineRaster, SolidFill; where parts are filled, FindOwners
  DeviceArray<uint32_t> inside, outside;  // bit grids; `outside` covers the whole grid
  SlabCounts counts;                      // valid after Counts

  uint64_t slab_rows() const { return uint64_t(slab_dims[1]) * uint64_t(slab_dims[2]); }
  uint64_t slab_words() const { return slab_rows() * uint64_t(view.words_per_row); }
  uint64_t slab_voxels() const { return slab_rows() * uint64_t(slab_dims[0]); }
};

// True if no voxel is covered, so there are no fragments.
inline bool CoversNothing(const RunState& state) {
  return state.request.request.coverage == Coverage::kNone;
}

// Bit grid of the voxels that triangles touch. It is the coverage unless all targets can discard.
inline uint32_t* TouchedBits(RunState& state) {
  return state.lists.touched_bits.empty() ? state.coverage.data() : state.lists.touched_bits.data();
}

// Allocates the counters, all 0, before their first use.
absl::Status EnsureCounters(RunState& state);
// Sets counters to 0.
absl::Status ClearCounters(RunState& state, std::initializer_list<Counter> which);
// Clears the counters of queues and of the span list, and those behind them up to `end`.
absl::Status ClearQueues(RunState& state, int end);
// Copies all counters to the host. Synchronizes with the stream.
absl::StatusOr<std::array<uint64_t, kCounters>> ReadCounters(RunState& state);

// The stages; pipeline/stages/stages.h describes each.
absl::StatusOr<MeshExtent> VertexShade(RunState& state);
absl::Status PlaceVertices(RunState& state);  // no-op if already done
absl::Status SetUpGrid(RunState& state, const GridSpec& grid);
absl::Status BeginSlab(RunState& state, const Slab& slab);
void AbandonSlab(RunState& state);         // synchronizes
absl::Status FindOwners(RunState& state);  // synchronizes
absl::Status FineRaster(RunState& state);
absl::Status SolidFill(RunState& state);      // flood: synchronizes
absl::Status EmitFragments(RunState& state);  // synchronizes
absl::Status SortFragments(RunState& state);  // may synchronize
// Sets counters[kBuckets] to the number of listed voxels.
absl::Status Resolve(RunState& state);
absl::Status MakeBricks(RunState& state);              // sparse: fills state.result; synchronizes
absl::StatusOr<ResultArrays> Finish(RunState& state);  // copies to the host; synchronizes

// True if any fragment shader needs more than the coverage.
bool AnyShading(const BoundRequest& request);
// True if an A-buffer's targets need shading: then its shaders run.
bool ShadesFragments(const BoundRequest& request);
// A dense target's clear value as a repeated 32-bit word.
uint32_t PatternOf(const CudaTarget& target);
// Describes a target of a request, without memory.
CudaTarget DescribeTarget(const TargetSpec& spec, const BoundShader& shader);
// Fills state.targets, without memory. Call after VertexShade.
void DescribeTargets(RunState& state);
// Inputs of the path plan for a grid. Call after DescribeTargets.
PathInputs PathInputsOf(const RunState& state, const GridSpec& grid);

// Number of triangles that fills the device with several per thread, and true if the run's mesh has that many.
uint64_t FineTriangles(const DeviceInfo& device);
bool IsFine(const RunState& state);

// Parts of stages.
absl::Status BlendDirectly(RunState& state);  // synchronizes, except for a sparse result
// Where parts are filled, after their fragments are blended: takes out the fragments of targets that hold the owner's
// alone, in voxels whose centre lies in a part of a higher rank.
absl::Status KeepOwners(RunState& state);
// Where parts are filled: counts the voxels that each part owns by geometry, in state.parts.counts.
absl::Status CountOwned(RunState& state);
// Stores blended values in a sparse result whose voxels are listed.
absl::Status StoreListed(RunState& state);
// Clears a bit grid of `words` words and sets the bits of layers [z_begin, z_end) that triangles touch.
absl::Status RasterRows(RunState& state, Coverage coverage, int64_t z_begin, int64_t z_end, uint32_t* bits,
                        uint64_t words);
absl::Status ParityInside(RunState& state);
absl::Status NonzeroInside(RunState& state);
absl::Status FloodInside(RunState& state);
// Adds the number of set bits of `a`, or of `a | b`, to a counter. `b` may be null.
absl::Status CountBits(RunState& state, const uint32_t* a, const uint32_t* b, uint64_t words, Counter counter);
absl::Status CountSlab(RunState& state);  // kVoxels; BeginSlab cleared the slab's other counters

}  // namespace voxelpipe::cuda
