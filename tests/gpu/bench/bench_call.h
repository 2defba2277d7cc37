// The measurement of the GPU table: a call of the CUDA backend, stage by stage, between CUDA events.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>
#include <memory>
#include <vector>

#include "absl/status/statusor.h"
#include "cuda/backend.h"
#include "pipeline/stages/backend.h"
#include "pipeline/stages/bind.h"

namespace voxelpipe::gpu {

// CUDA events: marks on a stream, and the milliseconds between neighbours.
class Marks {
 public:
  explicit Marks(size_t count);
  Marks(const Marks&) = delete;
  Marks& operator=(const Marks&) = delete;
  ~Marks();
  void Set(size_t i, cudaStream_t stream) { (void)cudaEventRecord(events_[i], stream); }
  absl::Status Wait();  // for the last
  double Between(size_t a, size_t b) const;

 private:
  std::vector<cudaEvent_t> events_;
};

// One call of the pipeline after another on one mesh that stays on the device. Backend and mesh must outlive it.
class Call {
 public:
  static absl::StatusOr<std::unique_ptr<Call>> Make(const Backend& backend, const TriangleMesh& mesh,
                                                    const VoxelizeRequest& request);

  const std::vector<cuda::DeviceStep>& steps() const { return steps_; }
  cudaStream_t stream();
  // Voxels that the last call occupied.
  absl::StatusOr<uint64_t> CountOccupied();

  // Marks before the first step and after the last; `each`: after every step.
  absl::Status Run(Marks& marks, bool each);

 private:
  Call() = default;

  BoundRequest bound_;
  JobContext job_;
  std::unique_ptr<Stages> stages_;  // refers to bound_ and job_
  std::vector<cuda::DeviceStep> steps_;
};

}  // namespace voxelpipe::gpu
