#include "gpu/bench/bench_call.h"

#include "absl/strings/str_cat.h"
#include "pipeline/voxelize.h"

namespace voxelpipe::gpu {
namespace {

absl::Status Cuda(cudaError_t error) {
  return error == cudaSuccess ? absl::OkStatus() : absl::InternalError(cudaGetErrorString(error));
}

}  // namespace

Marks::Marks(size_t count) : events_(count) {
  for (cudaEvent_t& event : events_) (void)cudaEventCreate(&event);
}

Marks::~Marks() {
  for (cudaEvent_t event : events_) (void)cudaEventDestroy(event);
}

absl::Status Marks::Wait() {
  return Cuda(cudaEventSynchronize(events_.back()));
}

double Marks::Between(size_t a, size_t b) const {
  float ms = 0;
  (void)cudaEventElapsedTime(&ms, events_[a], events_[b]);
  return double(ms);
}

absl::StatusOr<std::unique_ptr<Call>> Call::Make(const Backend& backend, const TriangleMesh& mesh,
                                                 const VoxelizeRequest& request) {
  auto call = std::unique_ptr<Call>(new Call);
  absl::StatusOr<BoundRequest> bound = BindRequest(JobContext(), mesh, request);
  if (!bound.ok()) return bound.status();
  call->bound_ = *std::move(bound);
  absl::StatusOr<std::unique_ptr<Stages>> stages = backend.Start(mesh, call->bound_, call->job_);
  if (!stages.ok()) return stages.status();
  call->stages_ = *std::move(stages);
  const absl::StatusOr<MeshExtent> extent = call->stages_->VertexShade();
  if (!extent.ok()) return extent.status();
  const absl::StatusOr<GridSpec> grid = FitGrid(request.grid, extent->box);
  if (!grid.ok()) return grid.status();
  const MeshSize size{mesh.triangles.size(), mesh.positions.size(), *extent};
  const absl::StatusOr<Surface> surface = call->stages_->Measure(*grid, size, false);
  if (!surface.ok()) return surface.status();
  call->stages_->Begin(*grid, *surface, nullptr);
  call->steps_ = cuda::StepsOf(*call->stages_);
  return call;
}

cudaStream_t Call::stream() {
  return cuda::StreamOf(*stages_);
}

absl::Status Call::Run(Marks& marks, bool each) {
  marks.Set(0, stream());
  for (size_t i = 0; i < steps_.size(); ++i) {
    if (absl::Status s = steps_[i].second(); !s.ok())
      return absl::Status(s.code(), absl::StrCat(steps_[i].first, ": ", std::string(s.message())));
    if (each || i + 1 == steps_.size()) marks.Set(each ? i + 1 : 1, stream());
  }
  return marks.Wait();
}

absl::StatusOr<uint64_t> Call::CountOccupied() {
  return cuda::CountOccupied(*stages_);
}

}  // namespace voxelpipe::gpu
