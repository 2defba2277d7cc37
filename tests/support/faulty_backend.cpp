#include "support/faulty_backend.h"

#include <chrono>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <thread>
#include <utility>

#include "base/device_failure.h"
#include "cpu/backend.h"

namespace voxelpipe::testing {

Fault ParseFault(const std::string& text) {
  Fault fault;
  std::istringstream words(text);
  for (std::string word; words >> word;) {
    const size_t at = word.find('=');
    if (at == std::string::npos) continue;
    const std::string key = word.substr(0, at), value = word.substr(at + 1);
    if (key == "kind") fault.kind = value;
    if (key == "stage") fault.stage = value;
    if (key == "runs") fault.runs = std::stoi(value);
    if (key == "slab") fault.slab = std::stoi(value);
    if (key == "probes") fault.probes = std::stoi(value);
    if (key == "probe") fault.probe = value;
  }
  return fault;
}

// The CPU's stages, until the fault comes.
class FaultyBackend::FaultyStages final : public Stages {
 public:
  FaultyStages(const FaultyBackend& backend, std::unique_ptr<Stages> inner, Fault fault)
      : backend_(backend), inner_(std::move(inner)), fault_(std::move(fault)) {}

  absl::Status Reach(const char* stage) const {
    if (fault_.kind.empty() || fault_.stage != stage) return absl::OkStatus();
    const bool slabs = fault_.stage != "start" && fault_.stage != "vertex_shade" && fault_.stage != "coarse_raster" &&
                       fault_.stage != "tile_sort";
    const bool stays = fault_.kind == "memory";  // thinner slabs find no room either
    if (slabs && (stays ? slab_ < fault_.slab : slab_ != fault_.slab)) return absl::OkStatus();
    const std::string what = "a fault was asked for in " + fault_.stage;
    if (fault_.kind == "stall") {
      backend_.Stall();
      return absl::OkStatus();
    }
    if (fault_.kind == "throw") throw std::runtime_error(what);
    if (fault_.kind == "memory") {
      return MarkDeviceFailure(absl::ResourceExhaustedError(what), DeviceFailureKind::kOutOfMemory);
    }
    return MarkDeviceFailure(absl::InternalError(what),
                             fault_.kind == "lost" ? DeviceFailureKind::kLost : DeviceFailureKind::kError);
  }

  absl::StatusOr<MeshExtent> VertexShade() override {
    if (absl::Status s = Reach("vertex_shade"); !s.ok()) return s;
    return inner_->VertexShade();
  }
  absl::StatusOr<Surface> Measure(const GridSpec& grid, const MeshSize& mesh, bool closely) const override {
    return inner_->Measure(grid, mesh, closely);
  }
  void Begin(const GridSpec& grid, const Surface& expected, ListMemory* lists) override {
    inner_->Begin(grid, expected, lists);
  }
  absl::Status SortTriangles(const Slab& slab, StageClock& clock) override {
    if (slab_ < 0) {
      if (absl::Status s = Reach("coarse_raster"); !s.ok()) return s;
    }
    if (absl::Status s = inner_->SortTriangles(slab, clock); !s.ok() || slab_ >= 0) return s;
    return Reach("tile_sort");
  }
  absl::Status FineRaster(const Slab& slab) override {
    if (absl::Status s = BeginSlab(); !s.ok()) return s;
    if (absl::Status s = Reach("fine_raster"); !s.ok()) return s;
    return inner_->FineRaster(slab);
  }
  absl::Status SolidFill() override { return inner_->SolidFill(); }
  absl::Status EmitFragments(const Slab& slab) override {
    if (absl::Status s = BeginSlab(); !s.ok()) return s;
    if (absl::Status s = Reach("emit"); !s.ok()) return s;
    return inner_->EmitFragments(slab);
  }
  absl::Status SortFragments() override { return inner_->SortFragments(); }
  absl::Status Resolve() override { return inner_->Resolve(); }
  SlabCounts Counts(StageClock& clock) const override { return inner_->Counts(clock); }
  absl::StatusOr<SlabArrays> Finish() override {
    if (absl::Status s = Reach("finish"); !s.ok()) return s;
    return inner_->Finish();
  }
  std::string_view simd() const override { return inner_->simd(); }

 private:
  absl::Status BeginSlab() {
    ++slab_;
    return Reach("begin_slab");
  }

  const FaultyBackend& backend_;
  const std::unique_ptr<Stages> inner_;
  const Fault fault_;
  int slab_ = -1;
};

FaultyBackend::FaultyBackend(std::string device, std::string control_file)
    : device_(std::move(device)), control_file_(std::move(control_file)) {}

void FaultyBackend::Set(const Fault& fault) {
  const std::lock_guard lock(mutex_);
  fault_ = fault;
  ++changes_;
}

int FaultyBackend::runs() const {
  const std::lock_guard lock(mutex_);
  return runs_;
}

void FaultyBackend::ReadControlFile() const {
  if (control_file_.empty()) return;
  std::ifstream file(control_file_);
  std::ostringstream text;
  text << file.rdbuf();
  const std::lock_guard lock(mutex_);
  if (text.str() == control_text_) return;
  control_text_ = text.str();
  fault_ = ParseFault(control_text_);
  ++changes_;
}

void FaultyBackend::Stall() const {
  uint64_t before;
  {
    const std::lock_guard lock(mutex_);
    before = changes_;
  }
  while (true) {
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    ReadControlFile();
    const std::lock_guard lock(mutex_);
    if (changes_ != before) return;
  }
}

absl::Status FaultyBackend::Probe() const {
  ReadControlFile();
  bool stalls, fails;
  {
    const std::lock_guard lock(mutex_);
    stalls = fault_.probe == "stall";
    fails = fault_.probes > 0;
    if (fails) --fault_.probes;
  }
  if (stalls) Stall();
  return fails ? absl::InternalError("the probe failed, as was asked for") : absl::OkStatus();
}

Footprint FaultyBackend::Predict(const VoxelizeRequest& request, const GridSpec& grid, const MeshSize& mesh,
                                 const Surface& surface, const PlanLimits& limits, Delivery delivery) const {
  return cpu::CpuBackend().Predict(request, grid, mesh, surface, limits, delivery);
}

std::string_view FaultyBackend::simd() const {
  return cpu::CpuBackend().simd();
}

absl::StatusOr<std::unique_ptr<Stages>> FaultyBackend::Start(const TriangleMesh& mesh, const BoundRequest& request,
                                                             const JobContext& job) const {
  ReadControlFile();
  Fault fault;
  {
    const std::lock_guard lock(mutex_);
    ++runs_;
    if (!fault_.kind.empty() && fault_.runs != 0) {
      fault = fault_;
      if (fault_.runs > 0) --fault_.runs;
    }
  }
  auto inner = cpu::CpuBackend().Start(mesh, request, job);
  if (!inner.ok()) return inner.status();
  auto stages = std::make_unique<FaultyStages>(*this, *std::move(inner), std::move(fault));
  if (absl::Status s = stages->Reach("start"); !s.ok()) return s;
  return stages;
}

void FaultyBackend::Run(int threads, const std::function<void()>& body) const {
  cpu::CpuBackend().Run(threads, body);
}

void FaultyBackend::RunEach(int threads, size_t count, const std::function<void(size_t)>& body) const {
  cpu::CpuBackend().RunEach(threads, count, body);
}

}  // namespace voxelpipe::testing
