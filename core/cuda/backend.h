// The CUDA backend: the pipeline's stages on one GPU.
#pragma once

#include <driver_types.h>

#include "absl/status/statusor.h"
#include "pipeline/stages.h"

namespace voxelpipe::cuda {

// Lives as long as the process; FAILED_PRECONDITION saying why where no device can be used. Safe to run several jobs at once,
// each on a stream of its own.
absl::StatusOr<const Backend*> CudaBackend();

// For benchmarks: the stream of stages that this backend started, ...
cudaStream_t StreamOf(Stages& stages);
// ... and the last step of a sparse or bucketed run without its copy to the host.
absl::Status MakeDeviceResult(Stages& stages);

}  // namespace voxelpipe::cuda
