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
#include "cuda/primitives/flat_shading.h"
#include "cuda/primitives/span.h"
#include "cuda/primitives/views.h"
#include "cuda/primitives/voxel_code.h"
#include "cuda/run/fragment_list.h"
#include "pipeline/stages/stages.h"
#include "raster/degenerate.h"

namespace voxelpipe {
struct PackedVertex;
}

namespace voxelpipe::cuda {

// Arrays of the shaded mesh on the device, and the view of them that shaders get.
struct DeviceMesh {
  DeviceArray<Vec3d> positions, index_positions;
  DeviceArray<VertexCode> codes;  // per vertex (voxel_code.h)
  DeviceArray<Vec3f> normals, velocities;
  DeviceArray<Vec4f> tangents, colors;
  DeviceArray<Vec2f> uv[2];
  DeviceArray<uint32_t> triangles;  // three a triangle
  DeviceArray<PartView> parts;
  DeviceArray<MaterialView> materials;
  DeviceArray<TextureView> textures;
  DeviceArray<AttributeView> attributes;
  std::vector<DeviceArray<float>> attribute_values;
  std::vector<DeviceArray<AttributeRun>> attribute_runs;
  std::vector<DeviceArray<uint8_t>> images;  // texels of level 0
  std::vector<DeviceArray<Vec4f>> mips;      // further levels
  MeshView host_view;                        // pointers into device memory
  DeviceArray<MeshView> view;                // the same on the device, one element
  bool as_loaded = false;                    // positions are the mesh's own, as it was loaded

  const uint32_t* triangle_list() const {
    return host_view.triangles == nullptr ? nullptr : &host_view.triangles[0][0];
  }
};

struct LargestTriangles;
// What walks over a scattered mesh read besides its arrays (mesh_locality.h); null: they do without.
struct ScatteredMesh {
  // Three a triangle, so that nothing is to be looked up: parts of RunState::box, whose extent is kept here
  // (fixed_point.h).
  const PackedVertex* packed = nullptr;
  // The same in the order of places (Morton, 1966), for walks to which triangles are all the same.
  const PackedVertex* placed = nullptr;
  const LargestTriangles* largest = nullptr;
  Vec3d extent;
  std::shared_ptr<const CachedArray> kept;  // what both lie in, with the mesh; or
  DeviceArray<uint8_t> own;                 // where no other run has the same
  bool tried = false;                       // to make it

  // The stream's work is done.
  void Drop() {
    packed = placed = nullptr;
    largest = nullptr;
    kept.reset();
    own.Free();
  }
};

// Device memory behind the views of one CudaTarget.
struct TargetMemory {
  DeviceArray<uint32_t> bits, presence;
  DeviceArray<uint8_t> dense;
};

// What a target that is blended without tiles has besides (blend_spans.cuh).
struct SpanTarget {
  DeviceArray<uint32_t> values, negative;  // of all triangles
  DeviceArray<int64_t> terms;
  DeviceArray<uint32_t> cells, counts;  // by rank
  DeviceArray<unsigned long long> sums;
  bool shaded = false;  // whether values or terms are made
  bool by_id = false;   // there are none: the value is the triangle's id
  FlatShading shading;
  DegenerateTest degenerate;  // of the run's triangles
};

// A list of owners: voxels within the slab, triangles, and where their values go.
struct OwnerList {
  DeviceArray<uint32_t> keys, triangles, to;

  void Free() {
    for (auto* array : {&keys, &triangles, &to}) array->Free();
  }
};

// A pool of bricks (brick_scatter.cuh): per brick of the slab, and per place.
struct PoolMemory {
  DeviceArray<uint32_t> places, cells, masks, bricks, voxels;

  void Free() {
    for (auto* array : {&places, &cells, &masks, &bricks, &voxels}) array->Free();
  }
};

// Arrays of a sparse or bucketed result on the device, as ResultArrays has them; the triangles of buckets are
// RunState::fragments.
struct DeviceResult {
  DeviceArray<uint64_t> bricks, voxels, offsets;
  DeviceArray<uint8_t> masks;
  std::vector<DeviceArray<uint8_t>> targets;
  // Known to the host; the voxels of buckets once the slab's counters are read.
  uint64_t listed_bricks = 0, listed_voxels = 0, listed_fragments = 0;
};

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

  // Sparse: per tile of the slab, and one more
  DeviceArray<uint32_t> brick_counts, voxel_counts;
  DeviceArray<uint64_t> first_brick, first_voxel;
  PoolMemory pool;

  // Buckets: EmitFragments, SortFragments
  DeviceArray<uint32_t> fragment_counts;  // per triangle
  // Per triangle: where its fragments begin before they are sorted. Or, of records, how many each chunk has
  // (FragmentCounts).
  DeviceArray<uint64_t> fragment_first;
  Fragments fragments;  // their keys are voxel indices within the slab
  // For CountAndListBuckets and UnpackIntoBuckets (fragment_list.h): 0 once fragments are emitted.
  DeviceArray<uint64_t> bucket_chunks;
  DeviceArray<uint64_t> bundles_before;  // for EmitBundles: per block of it

  // Blending without tiles, and the A-buffer: per triangle, as they are taken (coverage_record.h)
  DeviceArray<uint64_t> cells, blocks;
  DeviceArray<uint64_t> spans;  // of the slab (span.h), in no order, kNoSpan among them
  uint64_t span_count = 0;      // of all triangles, also where there was no room for them
  DeviceArray<uint32_t>
      touched_bits;  // bit grid: voxels of discarded fragments too; empty: none are, the coverage has all
  DeviceArray<uint32_t> word_ranks;   // per word of it, or of the coverage, where that is not empty (Ranks)
  DeviceArray<uint32_t> listed_bits;  // of a sparse result: the bit of each voxel
  uint64_t ranked_voxels = 0;         // that have accumulators
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
  return state.touched_bits.empty() ? state.coverage.data() : state.touched_bits.data();
}

// Elements of RunState::counters.
enum Counter : int {
  kFragments,   // of the slab
  kOddColumns,  // of the slab
  kVoxels,      // of the slab, with a fragment or filled
  kListedBricks,
  kListedVoxels,  // of a sparse result
  kChanged,       // flood: rows changed
  kRanks,         // voxels with a rank
  kBuckets,       // of the slab
  kBundles,       // of the slab's fragments
  kPooled,        // bricks that wanted a place in the pool
  kCleared,       // blocks that have cleared their part of a bit grid; 0 again when it is drawn
  kNever,         // always 0
  kScratch0,      // free for use within a stage
  kQueued0,       // entries of the queues of a stage
  kQueued1,
  kQueued2,
  kQueued3,
  kSpans,    // of the list; the queues and it are cleared in one, at the end
  kCounters  // behind them: kFragmentSlots, kChunkGroups (span.h)
};
inline constexpr int kAllCounters = kCounters + kFragmentSlots + kChunkGroups;

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
