// The CUDA backend: the pipeline's stages on one GPU.
#pragma once

#include <driver_types.h>

#include <functional>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe::cuda {

// One backend a device, lost ones too; they live as long as the process. Safe to run several jobs at once on each,
// every one on a stream of its own.
const std::vector<const Backend*>& CudaBackends();
// The first that is not lost; FAILED_PRECONDITION saying why where no device can be used.
absl::StatusOr<const Backend*> FirstCudaBackend();

// For benchmarks: the stream of stages that this backend started, ...
cudaStream_t StreamOf(Stages& stages);
// ... what a run over the whole grid that they have begun gives to it, step by step, without the copy to the host, ...
using DeviceStep = std::pair<const char*, std::function<absl::Status()>>;
std::vector<DeviceStep> StepsOf(Stages& stages);
// ... and the occupied voxels that these steps made.
absl::StatusOr<uint64_t> CountOccupied(Stages& stages);

}  // namespace voxelpipe::cuda
