#include "cpu/backend.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "cpu/a_buffer.h"
#include "cpu/run_state.h"
#include "cpu/thread_arena.h"

namespace voxelpipe::cpu {
namespace {

class CpuStages final : public Stages {
 public:
  CpuStages(const TriangleMesh& mesh, const BoundRequest& request, const JobContext& job, const RowKernels& kernels)
      : state_(mesh, request, job) {
    state_.kernels = &kernels;
  }

  absl::StatusOr<MeshExtent> VertexShade() override { return cpu::VertexShade(state_); }
  absl::Status CoarseRaster(const GridSpec& grid) override { return cpu::CoarseRaster(state_, grid); }
  absl::Status TileSort() override { return cpu::TileSort(state_); }
  absl::Status BeginSlab(const Slab& slab) override { return cpu::BeginSlab(state_, slab); }
  absl::Status FineRaster() override { return cpu::FineRaster(state_); }
  absl::Status SolidFill() override { return cpu::SolidFill(state_); }
  absl::Status EmitFragments() override { return cpu::EmitFragments(state_); }
  absl::Status SortFragments() override { return cpu::SortFragments(state_); }
  absl::Status Resolve() override { return cpu::Resolve(state_); }
  absl::StatusOr<ResultArrays> Finish() override { return cpu::Finish(state_); }
  uint64_t CountOccupied() const override {
    if (state_.a_buffer) return state_.a_buffer->voxels;
    return state_.inside.empty() ? CountBits(state_.coverage) : CountUnion(state_.coverage, state_.inside);
  }
  SlabCounts counts() const override { return state_.counts; }
  bool SortsTiles(const GridSpec& grid) const override { return !PlainBits(state_, grid); }
  std::string_view simd() const override { return state_.kernels->name; }

 private:
  RunState state_;
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
  void Run(int threads, const std::function<void()>& body) const override { ThreadArena(threads).execute(body); }
  void RunEach(int threads, size_t count, const std::function<void(size_t)>& body) const override {
    Run(threads, [&] {
      tbb::parallel_for(size_t{0}, count, [&](size_t i) {
        // A run that waits for its own loops must not begin another one meanwhile: its times would be wrong.
        tbb::this_task_arena::isolate([&] { body(i); });
      });
    });
  }
};

}  // namespace

const Backend& CpuBackend() {
  static const Cpu* backend = new Cpu;
  return *backend;
}

}  // namespace voxelpipe::cpu
