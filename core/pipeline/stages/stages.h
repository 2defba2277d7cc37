// One run of the pipeline on one backend. pipeline/voxelize.cpp calls the stages in the paper's order; each backend
// decides who runs them when.
//
// Source: J. Pantaleoni, "VoxelPipe: A Programmable Pipeline for 3D Voxelization", HPG 2011, section 3 (the sort-middle
// blending pipeline) and section 4 (the sort-last A-buffer). Changed: tiles are 32x8x8 voxels, coverage is taken as row
// spans, and the grid is worked on in slabs along z, so that memory is bounded whatever the grid.
#pragma once

#include <functional>
#include <memory>
#include <numeric>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "grid/grid_spec.h"
#include "grid/host_buffer.h"
#include "job/request.h"
#include "job/result.h"
#include "mesh/parts/part_list.h"
#include "mesh/triangle_mesh.h"
#include "pipeline/plan/footprint.h"
#include "pipeline/plan/list_memory.h"
#include "pipeline/plan/plan.h"
#include "pipeline/stages/stage_clock.h"
#include "shaders/catalog.h"

namespace voxelpipe {

// A request whose shaders are bound.
struct BoundRequest {
  VoxelizeRequest request;
  BoundShader vertex_shader;
  std::vector<BoundShader> fragment_shaders;  // one a target
  bool bodies_move = false;                   // HasMotions of the mesh
  std::shared_ptr<const PartList> parts;      // null: the request does not cut the mesh into parts
  // What the result says of the parts, but for what the run counts. Empty without parts, or if they are `whole`.
  PartTable part_table;
};

// Layers begin <= z < end of the grid; both multiples of kSlabGranularity, but for the last slab's end.
struct Slab {
  int64_t begin = 0, end = 0;
  int64_t depth() const { return end - begin; }
  bool operator==(const Slab&) const = default;
};

// What the stages of one slab leave besides its arrays.
struct SlabCounts {
  uint64_t occupied = 0;              // voxels with a fragment or filled
  std::optional<uint64_t> fragments;  // absent where a path does not count them
  uint64_t odd_columns = 0;
  // Where parts are filled, by rank; else empty. odd_columns is the sum of the first. Voxels: see PartTable::voxels.
  std::vector<uint64_t> part_odd_columns, part_voxels;
};

// The arrays of a slab that may still be on their way from the device. At its end it waits for them.
class SlabArrays {
 public:
  SlabArrays(ResultArrays arrays) : arrays_(std::move(arrays)) {}  // that are there
  SlabArrays(ResultArrays arrays, std::function<absl::Status()> wait)
      : arrays_(std::move(arrays)), wait_(std::move(wait)) {}
  SlabArrays(SlabArrays&& other) noexcept
      : arrays_(std::move(other.arrays_)), wait_(std::exchange(other.wait_, nullptr)) {}
  SlabArrays& operator=(SlabArrays&&) = delete;
  ~SlabArrays() { (void)Wait(); }

  bool there() const { return wait_ == nullptr; }
  absl::StatusOr<ResultArrays> Take() && {
    if (absl::Status s = Wait(); !s.ok()) return s;
    return std::move(arrays_);
  }

 private:
  absl::Status Wait() {
    const auto wait = std::exchange(wait_, nullptr);
    return wait ? wait() : absl::OkStatus();
  }

  ResultArrays arrays_;
  std::function<absl::Status()> wait_;
};

// Once a run: VertexShade, Measure for the plan, Begin. Then slab after slab, by ascending z:
//   dense, sparse   SortTriangles, FineRaster, SolidFill (only with a fill)
//   buckets         SortTriangles, EmitFragments, SortFragments, Resolve
// and of each Counts, where they are wanted, and Finish. Slabs may be made several times over, from the first one on.
// Every stage returns CANCELLED or DEADLINE_EXCEEDED as soon as it sees that the job should end, and RESOURCE_EXHAUSTED
// when memory is short. Where that has the mark kOutOfMemory (base/device_failure.h), the slab's memory is given back:
// a slab with fewer layers from the same one on may have room.
class Stages {
 public:
  virtual ~Stages() = default;

  // Runs the vertex shader over every vertex. Out: where the shaded mesh lies and how large its surface is.
  // INVALID_ARGUMENT naming node, primitive and vertex where one that a triangle uses is not finite.
  virtual absl::StatusOr<MeshExtent> VertexShade() = 0;

  // What the shaded mesh touches of a grid: as often as is asked after VertexShade. `mesh` has the extent that
  // VertexShade gave. `closely`: the triangles clipped to the grid wherever that can be had, whatever it costs, for a
  // run that does not fit by what was said before; where it is false, a backend may use a sample, or sums over the
  // whole mesh. Errors: the job's.
  virtual absl::StatusOr<Surface> Measure(const GridSpec& grid, const MeshSize& mesh, bool closely) const = 0;

  // In: the plan's layers of a slab. Out: the layers of a slab for which the device has room now, at most `depth`, a
  // multiple of kSlabGranularity unless it is `depth`. A device is asked only where its room is in doubt: that takes as
  // long as a small job.
  virtual int64_t FittingSlabDepth(const GridSpec& /*grid*/, const MeshSize& /*mesh*/, const Surface& /*surface*/,
                                   int64_t depth) const {
    return depth;
  }

  // The grid of all slabs, what the mesh is expected to touch of it, and whom stages ask before lists take more than
  // the plan has for them. `lists` outlives the stages; null: they need not ask.
  virtual void Begin(const GridSpec& grid, const Surface& expected, ListMemory* lists) = 0;

  // Sort-middle: finds the tiles of the slab that each triangle may touch ("coarse_raster" on `clock`), and sorts
  // (tile, triangle) pairs by tile ("tile_sort"); the order within a tile is the backend's own. A backend may sort the
  // triangles of all slabs with the first one. Nothing is done where a path needs no tiles.
  // INVALID_ARGUMENT, also of the two stages that follow, naming node, primitive and vertex for one beyond 2^40 voxels
  // of the grid's origin.
  virtual absl::Status SortTriangles(const Slab& slab, StageClock& clock) = 0;

  // Only where parts are filled (FillsParts), before FineRaster: which part's inside has the centre of each voxel.
  virtual absl::Status FindOwners(const Slab& /*slab*/) { return absl::UnimplementedError("parts on this backend"); }

  // Sets every voxel of the slab to its clear value; then coverage, fragment shading, blending and store, by tiles or
  // whatever the backend's path has in their place.
  virtual absl::Status FineRaster(const Slab& slab) = 0;

  // Fills the inside of the mesh where no fragment is.
  virtual absl::Status SolidFill() = 0;

  // A-buffer: a record for each (triangle, voxel) pair of the slab; ...
  virtual absl::Status EmitFragments(const Slab& slab) = 0;
  // ... by voxel, then by triangle id; ...
  virtual absl::Status SortFragments() = 0;
  // ... runs of equal voxels become buckets, fragments are shaded.
  virtual absl::Status Resolve() = 0;

  // Of the slab, all of whose stages have run. To count may take time that is not theirs: then `clock` is paused.
  virtual SlabCounts Counts(StageClock& clock) const = 0;

  // The slab's arrays in their result format. `offsets` count from the slab's own first fragment; bricks and voxels
  // carry the numbers of the whole grid. Those of a slab that is not all may still be on their way: stages go on with
  // the next one meanwhile. What is returned must end before the Finish after the next.
  virtual absl::StatusOr<SlabArrays> Finish() = 0;
  // The same for a dense slab that is the whole grid, whose arrays stay in the device's memory, if it has its own.
  virtual absl::StatusOr<SlabArrays> FinishOnDevice() { return Finish(); }

  // Instruction set of the row kernels of this run.
  virtual std::string_view simd() const = 0;
  // The path that made each target, by name; at the end of the run.
  virtual std::vector<std::string> Paths() const { return {}; }
};

struct BatchItem;   // pipeline/batch.h
struct BatchStats;  // likewise

// One device that can run the pipeline: the machine's processors, or one GPU. Thread-safe.
class Backend {
 public:
  virtual ~Backend() = default;
  virtual std::string_view name() const = 0;  // "cpu", "cuda"
  // Which of its kind: "cpu", "cuda:0", "cuda:1".
  virtual std::string device() const { return std::string(name()); }
  virtual std::string model() const { return {}; }     // as its maker calls it; empty where that is not known
  virtual uint64_t memory_bytes() const { return 0; }  // of the device; 0 where it works in the host's
  // In: a valid request, the grid it is fitted to, the mesh after its vertex shader and what it touches of the grid.
  // Out: the memory that a run takes, of the host and of the device together.
  virtual Footprint Predict(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                            const Surface& surface, const PlanLimits& limits, Delivery delivery) const = 0;
  // Whether the device can work now: allocates a little, runs something and reads it back. Errors say why not.
  virtual absl::Status Probe() const { return absl::OkStatus(); }
  virtual std::string_view simd() const = 0;  // best instruction set of the row kernels here, "scalar" where plain C++

  // `mesh`, `request` and `job` must outlive the returned object, and all calls to it come from inside Run.
  virtual absl::StatusOr<std::unique_ptr<Stages>> Start(const TriangleMesh& mesh, const BoundRequest& request,
                                                        const JobContext& job) const = 0;

  // Calls `body` where this backend wants its stages called (inside its thread arena).
  virtual void Run(int threads, const std::function<void()>& body) const = 0;

  // The same for `count` independent runs: calls body(0) ... body(count - 1), several at a time where the backend can.
  virtual void RunEach(int threads, size_t count, const std::function<void(size_t)>& body) const {
    Run(threads, [&] {
      for (size_t i = 0; i < count; ++i) body(i);
    });
  }

  // Runs together those of a batch's items that can share a pass of the device, gives them their results and adds to
  // `stats`. Out: the numbers of the others, which are to run alone; also of those that a pass could not finish, whose
  // hook was called with a plan already.
  virtual std::vector<size_t> RunShared(int /*threads*/, std::span<const BatchItem> items, const PlanLimits& /*limits*/,
                                        BatchStats& /*stats*/) const {
    std::vector<size_t> alone(items.size());
    std::iota(alone.begin(), alone.end(), size_t{0});
    return alone;
  }
};

}  // namespace voxelpipe
