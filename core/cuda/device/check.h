// Converts CUDA errors to statuses that name the call, its file and its line.
#pragma once

#include <cuda_runtime_api.h>

#include <cstdint>

#include "absl/status/status.h"

namespace voxelpipe::cuda {

// OK for cudaSuccess. Out of memory is RESOURCE_EXHAUSTED, everything else INTERNAL. A "sticky" error (illegal address,
// failed launch: every later call on the context returns it) marks the device lost (device.h). All carry the mark of
// base/device_failure.h.
absl::Status CudaStatus(cudaError_t error, const char* expression, const char* file, int line);

// Kernel launches made by the calling thread so far. Kernels of a graph count one by one; a call of CUB counts as one.
uint64_t LaunchesOfThread();
void CountLaunch();

}  // namespace voxelpipe::cuda

// Returns from the calling function (absl::Status or StatusOr) if a CUDA call fails.
#define VOXELPIPE_CUDA_OR_RETURN(call)                                             \
  do {                                                                             \
    if (const cudaError_t cuda_error = (call); cuda_error != cudaSuccess) {        \
      return ::voxelpipe::cuda::CudaStatus(cuda_error, #call, __FILE__, __LINE__); \
    }                                                                              \
  } while (0)

// The same after a kernel launch, for errors of the launch itself. Errors of the running kernel appear in a later call.
#define VOXELPIPE_LAUNCHED_OR_RETURN(kernel)                                                     \
  do {                                                                                           \
    ::voxelpipe::cuda::CountLaunch();                                                            \
    if (const cudaError_t cuda_error = cudaGetLastError(); cuda_error != cudaSuccess) {          \
      return ::voxelpipe::cuda::CudaStatus(cuda_error, "launch of " kernel, __FILE__, __LINE__); \
    }                                                                                            \
  } while (0)

#define VOXELPIPE_OK_OR_RETURN(expression)                                              \
  do {                                                                                  \
    if (absl::Status status_here = (expression); !status_here.ok()) return status_here; \
  } while (0)
