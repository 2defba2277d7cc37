// Marks functions that are compiled for the host and for CUDA devices alike.
//
// Everything that decides which voxel is touched or which value it gets carries VOXELPIPE_HD, so that both
// backends run the same operations in the same order and return the same bytes.
#pragma once

#if defined(__CUDACC__) || defined(__CUDACC_RTC__)
#define VOXELPIPE_HD __host__ __device__ inline
// For functions that many shaders call: device compilers inline all others, which copies large bodies into every
// caller.
#define VOXELPIPE_HD_CALL __host__ __device__ __noinline__ inline
#else
#define VOXELPIPE_HD inline
#define VOXELPIPE_HD_CALL inline
#endif
