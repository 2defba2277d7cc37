#include "cuda/backend.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <optional>

#include "absl/strings/str_cat.h"
#include "base/machine.h"
#include "cpu/measure/measure.h"
#include "cpu/rows/row_kernels.h"
#include "cuda/batch/batch.h"
#include "cuda/plan/footprint.h"
#include "cuda/run/run_state.h"
#include "cuda/targets/slab_copies.h"

namespace voxelpipe::cuda {
namespace {

constexpr size_t kRunsAtOnce = 4;  // of RunEach

class CudaStages final : public Stages {
 public:
  CudaStages(const TriangleMesh& mesh, const BoundRequest& request, const JobContext& job, const DeviceInfo& device,
             const cpu::RowKernels& kernels, DeviceUse use)
      : use_(std::move(use)), state_(mesh, request, job) {
    state_.host.kernels = &kernels;
    state_.device = device;
    state_.stream = use_.stream();
  }
  ~CudaStages() override {  // before what their work reads is released
    copies_.reset();
    use_.Wait();
  }

  absl::StatusOr<MeshExtent> VertexShade() override {
    absl::StatusOr<MeshExtent> extent = cuda::VertexShade(state_);
    if (extent.ok()) DescribeTargets(state_);
    return extent;
  }
  absl::StatusOr<Surface> Measure(const GridSpec& grid, const MeshSize& mesh, bool closely) const override {
    const VoxelizeRequest& request = state_.request.request;
    // The sums that the device made are those of the whole mesh. Where the vertices are the file's, the host has them
    // too.
    if (closely && request.vertex_shader.name == "identity") {
      return cpu::MeasureSurface(state_.host.view, request, grid, state_.job);
    }
    return EstimateSurface(request, grid, mesh);
  }
  int64_t FittingSlabDepth(const GridSpec& grid, const MeshSize& mesh, const Surface& surface,
                           int64_t depth) const override {
    constexpr uint64_t kShareInDoubt = 8;  // of the device's memory: a slab that takes less has room
    const VoxelizeRequest& request = state_.request.request;
    const uint64_t all = std::min(state_.device.memory_bytes, MemoryLimit());
    if (PredictSlabBytes(request, grid, mesh, surface, depth) < all / kShareInDoubt) return depth;
    return cuda::FittingSlabDepth(request, grid, mesh, surface, depth, FreeMemory(state_.device.ordinal));
  }
  void SetLists(const Surface& expected, ListMemory* memory) override {
    state_.expected = expected;
    state_.memory.AskFrom(memory);
  }
  absl::Status CoarseRaster(const GridSpec& grid, const Slab& layers) override {
    if (absl::Status s = state_.memory.TakeOnHost(0); !s.ok()) return s;  // likewise
    return cuda::CoarseRaster(state_, grid, layers);
  }
  absl::Status TileSort() override { return state_.plan.sorts_tiles() ? cuda::TileSort(state_) : absl::OkStatus(); }
  absl::Status BeginSlab(const Slab& slab) override {
    counted_ = false;
    if (absl::Status s = state_.memory.TakeOnHost(0); !s.ok()) return s;  // the lists before are held by the run now
    return cuda::BeginSlab(state_, slab);
  }
  absl::Status FineRaster() override { return cuda::FineRaster(state_); }
  absl::Status SolidFill() override { return cuda::SolidFill(state_); }
  absl::Status EmitFragments() override { return cuda::EmitFragments(state_); }
  absl::Status SortFragments() override { return cuda::SortFragments(state_); }
  absl::Status Resolve() override { return cuda::Resolve(state_); }
  absl::StatusOr<ResultArrays> Finish() override {
    Count();
    if (!count_status_.ok()) return count_status_;
    return cuda::Finish(state_);
  }
  absl::StatusOr<SlabArrays> FinishLater() override {
    if (state_.request.request.result != ResultKind::kDense) return Stages::FinishLater();
    Count();
    if (!count_status_.ok()) return count_status_;
    if (!copies_) {
      absl::StatusOr<SlabCopies> copies = SlabCopies::Make(state_.device.ordinal);
      if (!copies.ok()) return copies.status();
      copies_.emplace(*std::move(copies));
    }
    return copies_->Start(state_);
  }
  uint64_t CountOccupied() const override {
    Count();
    return occupied_;
  }
  SlabCounts counts() const override {
    Count();
    return state_.counts;
  }
  bool counts_wait() const override { return true; }
  bool SortsTiles(const GridSpec& grid) const override { return PlanPath(PathInputsOf(state_, grid)).sorts_tiles(); }
  bool SortsTilesBySlab() const override { return true; }
  std::string_view simd() const override { return "cuda"; }
  std::vector<std::string> Paths() const override {
    std::vector<std::string> paths;
    for (int i = 0; i < state_.targets.count; ++i) paths.push_back(PathName(state_.plan, i));
    return paths;
  }
  bool AbandonSlab() override {
    if (copies_) copies_->Forget();
    cuda::AbandonSlab(state_);
    return true;
  }

  RunState& state() { return state_; }

 private:
  // The counts of the slab come to the host in one read; an error waits for Finish.
  void Count() const {
    if (counted_) return;
    counted_ = true;
    count_status_ = CountSlab(state_);
    if (!count_status_.ok()) return;
    const auto counters = ReadCounters(state_);
    if (!counters.ok()) {
      count_status_ = counters.status();
      return;
    }
    const bool buckets = state_.request.request.result == ResultKind::kBuckets;
    if (buckets) state_.result.listed_voxels = (*counters)[kBuckets];
    occupied_ = (*counters)[buckets ? kBuckets : kVoxels];
    state_.counts.odd_columns = (*counters)[kOddColumns];
    if (buckets) {
      state_.counts.fragments = state_.result.listed_fragments;
    } else if (state_.plan.path != Path::kOccupancy) {
      state_.counts.fragments = (*counters)[kFragments];
    }
  }

  DeviceUse use_;  // destroyed last: arrays give their memory back on the stream
  mutable RunState state_;
  std::optional<SlabCopies> copies_;
  mutable bool counted_ = false;
  mutable uint64_t occupied_ = 0;
  mutable absl::Status count_status_;
};

class Cuda final : public Backend {
 public:
  explicit Cuda(DeviceInfo device) : device_(std::move(device)) {}

  std::string_view name() const override { return "cuda"; }
  std::string device() const override { return absl::StrCat("cuda:", device_.ordinal); }
  std::string model() const override { return device_.name; }
  uint64_t memory_bytes() const override { return std::min(device_.memory_bytes, MemoryLimit()); }
  Footprint Predict(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh, const Surface& surface,
                    const PlanLimits& limits, Delivery delivery) const override {
    return PredictFootprint(request, grid, mesh, surface, limits, delivery);
  }
  absl::Status Probe() const override { return ProbeDevice(device_.ordinal); }
  std::string_view simd() const override { return "cuda"; }
  absl::StatusOr<std::unique_ptr<Stages>> Start(const TriangleMesh& mesh, const BoundRequest& request,
                                                const JobContext& job) const override {
    const absl::StatusOr<const cpu::RowKernels*> kernels = cpu::SelectRowKernels(request.request.simd);
    if (!kernels.ok()) return kernels.status();
    absl::StatusOr<DeviceUse> use = DeviceUse::Begin(device_.ordinal);
    if (!use.ok()) return use.status();
    return std::make_unique<CudaStages>(mesh, request, job, device_, **kernels, *std::move(use));
  }
  void Run(int threads, const std::function<void()>& body) const override {
    const int cores = CpuCount();  // results are put together on the host
    tbb::task_arena arena(threads > 0 ? std::min(threads, cores) : cores);
    arena.execute(body);
  }
  void RunEach(int threads, size_t count, const std::function<void(size_t)>& body) const override {
    // Each on a stream of its own: while one copies, another computes.
    const int at_once = int(std::min<size_t>(count, kRunsAtOnce));
    Run(threads, [&] {
      std::atomic<size_t> next{0};
      tbb::parallel_for(0, at_once, [&](int) {
        for (size_t i = next++; i < count; i = next++) {
          // A run that waits for its own loops must not begin another one meanwhile: its times would be wrong.
          tbb::this_task_arena::isolate([&] { body(i); });
        }
      });
    });
  }
  std::vector<size_t> RunShared(int threads, std::span<const BatchItem> items, const PlanLimits& limits,
                                BatchStats& stats) const override {
    std::vector<size_t> alone;
    if (!CheckDevice(device_.ordinal).ok()) return Backend::RunShared(threads, items, limits, stats);  // each says why
    Run(threads, [&] { alone = cuda::RunShared(*this, device_, items, limits, stats); });
    return alone;
  }

 private:
  const DeviceInfo device_;
};

}  // namespace

const std::vector<const Backend*>& CudaBackends() {
  static const auto* const backends = [] {
    auto* const made = new std::vector<const Backend*>;
    if (const auto devices = AllDevices(); devices.ok()) {
      for (const DeviceInfo& device : **devices) made->push_back(new Cuda(device));
    }
    return made;
  }();
  return *backends;
}

absl::StatusOr<const Backend*> FirstCudaBackend() {
  const auto devices = AllDevices();
  if (!devices.ok()) return devices.status();
  absl::Status lost;
  for (size_t i = 0; i < (*devices)->size(); ++i) {
    absl::Status status = CheckDevice((**devices)[i].ordinal);
    if (status.ok()) return CudaBackends()[i];
    if (lost.ok()) lost = std::move(status);
  }
  return lost;
}

cudaStream_t StreamOf(Stages& stages) {
  return static_cast<CudaStages&>(stages).state().stream;
}

absl::Status MakeDeviceResult(Stages& stages) {
  RunState& state = static_cast<CudaStages&>(stages).state();
  return state.request.request.result == ResultKind::kSparse ? MakeBricks(state) : absl::OkStatus();
}

}  // namespace voxelpipe::cuda
