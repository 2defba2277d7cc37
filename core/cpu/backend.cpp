#include "cpu/backend.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "base/parallel.h"
#include "base/threads.h"
#include "cpu/a_buffer.h"
#include "cpu/footprint.h"
#include "cpu/run_state.h"
#include "host_mesh/kept_surfaces.h"
#include "host_mesh/measure.h"
#include "host_mesh/vertex_shade.h"

namespace voxelpipe::cpu {
namespace {

constexpr int64_t kCountWords = 1 << 16;  // between two checks of the job

// Number of voxels in at least one of two grids of the same dims, the second of which may be empty. Any number if the
// job was cancelled.
uint64_t CountRows(const BitGrid& a, const BitGrid& b, const JobContext& job) {
  const BitGrid& other = b.empty() ? a : b;
  std::atomic<uint64_t> total{0};
  ParallelChunks(a.rows(), std::max<int64_t>(1, kCountWords / a.words_per_row()), job, [&](int64_t begin, int64_t end) {
    // Rows follow each other: one call for all of them, as those of small grids have one word.
    const auto words = size_t((end - begin) * a.words_per_row());
    const std::span<const uint32_t> rows_a(a.row(begin).data(), words), rows_b(other.row(begin).data(), words);
    total.fetch_add(CountUnion(rows_a, rows_b), std::memory_order_relaxed);
  }).IgnoreError();  // the next stage returns the error
  return total;
}

class CpuStages final : public Stages {
 public:
  CpuStages(const TriangleMesh& mesh, const BoundRequest& request, const JobContext& job, const RowKernels& kernels)
      : state_(mesh, request, job) {
    state_.kernels = &kernels;
  }

  absl::StatusOr<MeshExtent> VertexShade() override { return ShadeHostMesh(state_); }
  absl::StatusOr<Surface> Measure(const GridSpec& grid, const MeshSize& mesh, bool closely) const override {
    const VoxelizeRequest& request = state_.request.request;
    if (state_.view.triangle_count == 0) return EstimateSurface(request, grid, mesh);
    const std::string key = SurfaceKey(state_, grid, closely);
    if (std::optional<Surface> kept = FindSurface(key)) return *std::move(kept);
    absl::StatusOr<Surface> surface = closely ? MeasureSurface(state_.view, request, grid, state_.job)
                                              : SampleSurface(state_.view, request, grid, state_.job);
    if (surface.ok()) KeepSurface(key, *surface);
    return surface;
  }
  void Begin(const GridSpec& grid, const Surface& /*expected*/, ListMemory* lists) override {
    grid_ = grid;
    state_.lists = lists;
  }
  // Of all slabs, before the first one.
  absl::Status SortTriangles(const Slab& /*slab*/, StageClock& clock) override {
    if (placed_ || PlainBits(state_, grid_)) return absl::OkStatus();
    absl::Status s = clock("coarse_raster", [&] { return Place(); });
    if (s.ok()) s = clock("tile_sort", [&] { return cpu::TileSort(state_); });
    return s;
  }
  absl::Status FindOwners(const Slab& slab) override {
    if (absl::Status s = BeginSlab(slab); !s.ok()) return s;
    return cpu::FindOwners(state_);
  }
  absl::Status FineRaster(const Slab& slab) override {
    if (!state_.by_parts) {  // FindOwners has begun it
      if (absl::Status s = BeginSlab(slab); !s.ok()) return s;
    }
    return cpu::FineRaster(state_);
  }
  absl::Status SolidFill() override { return cpu::SolidFill(state_); }
  absl::Status EmitFragments(const Slab& slab) override {
    if (absl::Status s = BeginSlab(slab); !s.ok()) return s;
    return cpu::EmitFragments(state_);
  }
  absl::Status SortFragments() override { return cpu::SortFragments(state_); }
  absl::Status Resolve() override { return cpu::Resolve(state_); }
  SlabCounts Counts(StageClock& clock) const override {
    clock.Pause();
    SlabCounts counts = state_.counts;
    counts.occupied = state_.a_buffer ? state_.a_buffer->voxels : CountRows(state_.coverage, state_.inside, state_.job);
    return counts;
  }
  absl::StatusOr<SlabArrays> Finish() override {
    absl::StatusOr<ResultArrays> arrays = cpu::Finish(state_);
    if (!arrays.ok()) return arrays.status();
    return SlabArrays(*std::move(arrays));
  }
  std::string_view simd() const override { return state_.kernels->name; }
  std::vector<std::string> Paths() const override {
    const VoxelizeRequest& request = state_.request.request;
    const char* const path = request.result == ResultKind::kBuckets ? "fragment list"
                             : request.coverage == Coverage::kNone  ? "nothing"
                             : PlainBits(state_, grid_)             ? "occupancy"
                                                                    : "tiles";
    return std::vector<std::string>(request.targets.size(), path);
  }

 private:
  // The mesh in the grid, once a run.
  absl::Status Place() {
    absl::Status s = cpu::CoarseRaster(state_, grid_);
    placed_ = s.ok();
    return s;
  }
  absl::Status BeginSlab(const Slab& slab) {
    if (!placed_) {  // no tiles are sorted
      if (absl::Status s = Place(); !s.ok()) return s;
    }
    return cpu::BeginSlab(state_, slab);
  }

  RunState state_;
  GridSpec grid_;
  bool placed_ = false;
};

class Cpu final : public Backend {
 public:
  std::string_view name() const override { return "cpu"; }
  std::string_view simd() const override { return (*SelectRowKernels(SimdChoice::kAuto))->name; }
  absl::StatusOr<std::unique_ptr<Stages>> Start(const TriangleMesh& mesh, const BoundRequest& request,
                                                const JobContext& job) const override {
    const absl::StatusOr<const RowKernels*> kernels = SelectRowKernels(request.request.simd);
    if (!kernels.ok()) return kernels.status();
    return std::make_unique<CpuStages>(mesh, request, job, **kernels);
  }
  Footprint Predict(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh, const Surface& surface,
                    const PlanLimits& limits, Delivery delivery) const override {
    return PredictFootprint(request, grid, mesh, surface, limits, delivery);
  }
  void Run(int threads, const std::function<void()>& body) const override { RunOnThreads(threads, body); }
  void RunEach(int threads, size_t count, const std::function<void(size_t)>& body) const override {
    RunEachOnThreads(threads, count, body);
  }
};

}  // namespace

const Backend& CpuBackend() {
  static const Cpu* backend = new Cpu;
  return *backend;
}

}  // namespace voxelpipe::cpu
