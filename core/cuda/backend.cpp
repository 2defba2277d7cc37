// The CUDA backend: binds the pipeline's stages to the functions of this folder, and selects devices.
#include "cuda/backend.h"

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <optional>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/device_failure.h"
#include "base/machine.h"
#include "cuda/batch/batch.h"
#include "cuda/plan/footprint.h"
#include "cuda/run/run_state.h"
#include "cuda/targets/slab_copies.h"
#include "host_mesh/measure.h"

namespace voxelpipe::cuda {
namespace {

constexpr size_t kRunsAtOnce = 4;  // for RunEach

class CudaStages final : public Stages {
 public:
  CudaStages(const TriangleMesh& mesh, const BoundRequest& request, const JobContext& job, const DeviceInfo& device,
             DeviceUse use)
      : use_(std::move(use)), state_(mesh, request, job) {
    state_.device = device;
    state_.stream = use_.stream();
  }
  ~CudaStages() override {  // before the memory that queued work reads is released
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
    // The device's sums are those of the whole mesh. If the vertices are those of the file, the host can measure them
    // within the grid.
    if (closely && request.vertex_shader.name == "identity") {
      return MeasureSurface(state_.host.view, request, grid, state_.job);
    }
    return EstimateSurface(request, grid, mesh);
  }
  int64_t FittingSlabDepth(const GridSpec& grid, const MeshSize& mesh, const Surface& surface,
                           int64_t depth) const override {
    // Divisor of the device's memory: smaller slabs fit without asking the driver.
    constexpr uint64_t kShareInDoubt = 8;
    const VoxelizeRequest& request = state_.request.request;
    const uint64_t all = std::min(state_.device.memory_bytes, MemoryLimit());
    if (PredictSlabBytes(request, grid, mesh, surface, depth) < all / kShareInDoubt) return depth;
    return cuda::FittingSlabDepth(request, grid, mesh, surface, depth, FreeMemory(state_.device.ordinal));
  }
  void Begin(const GridSpec& grid, const Surface& expected, ListMemory* lists) override {
    grid_ = grid;
    state_.expected = expected;
    state_.memory.AskFrom(lists);
  }
  absl::Status SortTriangles(const Slab& /*slab*/, StageClock& /*clock*/) override { return absl::OkStatus(); }
  absl::Status FindOwners(const Slab& slab) override {
    absl::Status s = BeginSlab(slab);
    if (s.ok()) s = cuda::FindOwners(state_);
    return Checked(std::move(s));
  }
  absl::Status FineRaster(const Slab& slab) override {
    absl::Status s = state_.parts.filled ? absl::OkStatus() : BeginSlab(slab);  // FindOwners began it
    if (s.ok()) s = cuda::FineRaster(state_);
    if (s.ok() && state_.request.request.fill == Fill::kNone) s = Count();
    return Checked(std::move(s));
  }
  absl::Status SolidFill() override {
    absl::Status s = cuda::SolidFill(state_);
    if (s.ok()) s = Count();
    return Checked(std::move(s));
  }
  absl::Status EmitFragments(const Slab& slab) override {
    absl::Status s = BeginSlab(slab);
    if (s.ok()) s = cuda::EmitFragments(state_);
    return Checked(std::move(s));
  }
  absl::Status SortFragments() override { return Checked(cuda::SortFragments(state_)); }
  absl::Status Resolve() override {
    absl::Status s = cuda::Resolve(state_);
    if (s.ok()) s = Count();
    return Checked(std::move(s));
  }
  SlabCounts Counts(StageClock& /*clock*/) const override { return state_.counts; }
  absl::StatusOr<SlabArrays> Finish() override {
    absl::StatusOr<SlabArrays> arrays = CopyOut();
    if (!arrays.ok()) return Checked(arrays.status());
    return arrays;
  }
  absl::StatusOr<SlabArrays> FinishOnDevice() override {
    absl::StatusOr<ResultArrays> arrays = KeepDense(state_);
    if (!arrays.ok()) return Checked(arrays.status());
    return SlabArrays(*std::move(arrays));
  }
  std::string_view simd() const override { return "cuda"; }
  std::vector<std::string> Paths() const override {
    std::vector<std::string> paths;
    for (int i = 0; i < state_.targets.count; ++i) paths.push_back(PathName(state_.plan, i));
    return paths;
  }

  // For benchmarks (backend.h).
  RunState& state() { return state_; }
  std::vector<DeviceStep> Steps() {
    const Slab all{0, grid_.dims[2]};
    const ResultKind kind = state_.request.request.result;
    std::vector<DeviceStep> steps;
    steps.emplace_back("SetUpGrid", [this] { return SetUpGrid(); });
    steps.emplace_back("BeginSlab", [this, all] { return Allocate(all); });
    if (kind == ResultKind::kBuckets) {
      steps.emplace_back("EmitFragments", [this] { return cuda::EmitFragments(state_); });
      steps.emplace_back("SortFragments", [this] { return cuda::SortFragments(state_); });
      steps.emplace_back("Resolve", [this] { return cuda::Resolve(state_); });
    } else {
      steps.emplace_back("FineRaster", [this] { return cuda::FineRaster(state_); });
    }
    if (kind == ResultKind::kSparse) steps.emplace_back("MakeBricks", [this] { return MakeBricks(state_); });
    return steps;
  }
  absl::StatusOr<uint64_t> CountOccupied() {
    VOXELPIPE_OK_OR_RETURN(Count());
    return state_.counts.occupied;
  }

 private:
  absl::Status SetUpGrid() {
    VOXELPIPE_OK_OR_RETURN(TakeLists());
    return cuda::SetUpGrid(state_, grid_);
  }
  absl::Status Allocate(const Slab& slab) {
    VOXELPIPE_OK_OR_RETURN(TakeLists());
    return cuda::BeginSlab(state_, slab);
  }
  absl::Status BeginSlab(const Slab& slab) {
    if (!set_up_) {
      VOXELPIPE_OK_OR_RETURN(SetUpGrid());
      set_up_ = true;
    }
    return Allocate(slab);
  }
  // The run holds the previous slab's lists from now on.
  absl::Status TakeLists() { return state_.memory.TakeOnHost(0); }

  // Releases what the slab allocated if the device is out of memory.
  absl::Status Checked(absl::Status s) {
    if (DeviceFailureOf(s) != DeviceFailureKind::kOutOfMemory) return s;
    if (copies_) copies_->Forget();
    AbandonSlab(state_);
    return s;
  }

  // Ends the slab's stages: waits for them, and reads all counts in one copy.
  absl::Status Count() {
    VOXELPIPE_OK_OR_RETURN(CountSlab(state_));
    const PartState& parts = state_.parts;
    std::vector<uint64_t> of_parts(parts.counts.size());
    if (!of_parts.empty()) {
      VOXELPIPE_CUDA_OR_RETURN(cudaMemcpyAsync(of_parts.data(), parts.counts.data(), parts.counts.bytes(),
                                               cudaMemcpyDeviceToHost, state_.stream));
    }
    const auto counters = ReadCounters(state_);
    if (!counters.ok()) return counters.status();
    const bool buckets = state_.request.request.result == ResultKind::kBuckets;
    if (buckets) state_.result.listed_voxels = (*counters)[kBuckets];
    state_.counts.occupied = (*counters)[buckets ? kBuckets : kVoxels];
    state_.counts.odd_columns = (*counters)[kOddColumns];
    state_.counts.part_odd_columns.assign(of_parts.begin(), of_parts.begin() + ptrdiff_t(of_parts.size() / 2));
    state_.counts.part_voxels.assign(of_parts.begin() + ptrdiff_t(of_parts.size() / 2), of_parts.end());
    if (buckets) {
      state_.counts.fragments = state_.result.listed_fragments;
    } else if (state_.plan.path != Path::kOccupancy) {
      state_.counts.fragments = (*counters)[kFragments];
    }
    return absl::OkStatus();
  }

  absl::StatusOr<SlabArrays> CopyOut() {
    const bool last = state_.slab.depth() == grid_.dims[2];  // no further slab to overlap with
    if (last || state_.request.request.result != ResultKind::kDense) {
      absl::StatusOr<ResultArrays> arrays = cuda::Finish(state_);
      if (!arrays.ok()) return arrays.status();
      return SlabArrays(*std::move(arrays));
    }
    if (!copies_) {
      absl::StatusOr<SlabCopies> copies = SlabCopies::Make(state_.device.ordinal);
      if (!copies.ok()) return copies.status();
      copies_.emplace(*std::move(copies));
    }
    return copies_->Start(state_);
  }

  DeviceUse use_;  // destroyed last: arrays return their memory on its stream
  RunState state_;
  GridSpec grid_;
  bool set_up_ = false;
  std::optional<SlabCopies> copies_;
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
    absl::StatusOr<DeviceUse> use = DeviceUse::Begin(device_.ordinal);
    if (!use.ok()) return use.status();
    return std::make_unique<CudaStages>(mesh, request, job, device_, *std::move(use));
  }
  void Run(int threads, const std::function<void()>& body) const override {
    const int cores = CpuCount();  // the host assembles results
    tbb::task_arena arena(threads > 0 ? std::min(threads, cores) : cores);
    arena.execute(body);
  }
  void RunEach(int threads, size_t count, const std::function<void(size_t)>& body) const override {
    // Each run has its own stream, so that one copies while another computes.
    const int at_once = int(std::min<size_t>(count, kRunsAtOnce));
    Run(threads, [&] {
      std::atomic<size_t> next{0};
      tbb::parallel_for(0, at_once, [&](int) {
        for (size_t i = next++; i < count; i = next++) {
          // Without isolation, a thread that waits for its loops could start another run, which would distort its
          // times.
          tbb::this_task_arena::isolate([&] { body(i); });
        }
      });
    });
  }
  std::vector<size_t> RunShared(int threads, std::span<const BatchItem> items, const PlanLimits& limits,
                                BatchStats& stats) const override {
    std::vector<size_t> alone;
    // Each reports the reason.
    if (!CheckDevice(device_.ordinal).ok()) return Backend::RunShared(threads, items, limits, stats);
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

std::vector<DeviceStep> StepsOf(Stages& stages) {
  return static_cast<CudaStages&>(stages).Steps();
}

absl::StatusOr<uint64_t> CountOccupied(Stages& stages) {
  return static_cast<CudaStages&>(stages).CountOccupied();
}

}  // namespace voxelpipe::cuda
