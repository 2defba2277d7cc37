// The CUDA backend: runs the pipeline's stages on one GPU.
#pragma once

#include <driver_types.h>

#include <functional>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "pipeline/stages/stages.h"

namespace voxelpipe::cuda {

// One backend per device, including lost ones; they live as long as the process. Each can run several jobs at a time,
// on a stream each.
const std::vector<const Backend*>& CudaBackends();
// The first one that is not lost; FAILED_PRECONDITION with the reason if no device can be used.
absl::StatusOr<const Backend*> FirstCudaBackend();

// For benchmarks: the stream of stages that this backend started, ...
cudaStream_t StreamOf(Stages& stages);
// ... the steps of a run over the whole grid, for stages that have begun, without the copy to the host, ...
using DeviceStep = std::pair<const char*, std::function<absl::Status()>>;
std::vector<DeviceStep> StepsOf(Stages& stages);
// ... and the number of occupied voxels that these steps made.
absl::StatusOr<uint64_t> CountOccupied(Stages& stages);

}  // namespace voxelpipe::cuda
