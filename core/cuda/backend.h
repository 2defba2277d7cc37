// The CUDA backend: the pipeline's stages on one GPU.
#pragma once

#include <driver_types.h>

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
// ... and the last step of a sparse or bucketed run without its copy to the host.
absl::Status MakeDeviceResult(Stages& stages);

}  // namespace voxelpipe::cuda
