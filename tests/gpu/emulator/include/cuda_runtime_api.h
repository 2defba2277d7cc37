// The part of the CUDA runtime's interface that core/cuda uses, on host memory: streams run their work immediately.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>

#include "driver_types.h"

enum cudaError_t {
  cudaSuccess = 0,
  cudaErrorMemoryAllocation = 2,
  cudaErrorIllegalAddress,
  cudaErrorLaunchFailure,
  cudaErrorHardwareStackError,
  cudaErrorIllegalInstruction,
  cudaErrorMisalignedAddress,
  cudaErrorInvalidAddressSpace,
  cudaErrorInvalidPc,
  cudaErrorAssert,
  cudaErrorECCUncorrectable,
  cudaErrorLaunchTimeout,
  cudaErrorNotSupported,
};
enum cudaMemcpyKind { cudaMemcpyHostToHost, cudaMemcpyHostToDevice, cudaMemcpyDeviceToHost, cudaMemcpyDeviceToDevice };
enum cudaMemPoolAttr {
  cudaMemPoolAttrReleaseThreshold,
  cudaMemPoolAttrReservedMemCurrent,
  cudaMemPoolAttrUsedMemCurrent
};
enum cudaFuncAttribute { cudaFuncAttributeMaxDynamicSharedMemorySize, cudaFuncAttributePreferredSharedMemoryCarveout };
enum { cudaStreamNonBlocking = 1 };

struct cudaDeviceProp {
  char name[64] = "emulated";
  int multiProcessorCount = 3;
  size_t sharedMemPerBlockOptin = 227 * 1024, sharedMemPerMultiprocessor = 228 * 1024;
  size_t totalGlobalMem = size_t{4} << 30;
};

inline cudaError_t cudaGetDeviceCount(int* count) {
  return *count = 1, cudaSuccess;
}
inline cudaError_t cudaGetDevice(int* ordinal) {
  return *ordinal = 0, cudaSuccess;
}
inline cudaError_t cudaSetDevice(int) {
  return cudaSuccess;
}
// CUDA_EMULATOR_MEMORY in the environment: the memory of a smaller device, in bytes.
inline cudaError_t cudaGetDeviceProperties(cudaDeviceProp* properties, int) {
  *properties = cudaDeviceProp();
  if (const char* bytes = std::getenv("CUDA_EMULATOR_MEMORY"))
    properties->totalGlobalMem = std::strtoull(bytes, nullptr, 10);
  return cudaSuccess;
}
enum cudaDeviceAttr { cudaDevAttrL2CacheSize = 38, cudaDevAttrCooperativeLaunch = 95 };
// Blocks run one after the other. The cache is so small that most grids are many times larger; CUDA_EMULATOR_CACHE: its
// bytes.
inline cudaError_t cudaDeviceGetAttribute(int* value, cudaDeviceAttr attribute, int) {
  const char* const bytes = std::getenv("CUDA_EMULATOR_CACHE");
  const int cache = bytes != nullptr ? std::atoi(bytes) : 2048;
  return *value = attribute == cudaDevAttrL2CacheSize ? cache : 0, cudaSuccess;
}
struct cudaFuncAttributes {
  int ptxVersion;
};
// Code for devices with programmatic dependent launch.
template <typename Kernel>
cudaError_t cudaFuncGetAttributes(cudaFuncAttributes* attributes, Kernel*) {
  return *attributes = {90}, cudaSuccess;
}
inline cudaError_t cudaDeviceGetDefaultMemPool(cudaMemPool_t*, int) {
  return cudaSuccess;
}
inline cudaError_t cudaMemPoolSetAttribute(cudaMemPool_t, cudaMemPoolAttr, void*) {
  return cudaSuccess;
}
inline cudaError_t cudaDeviceGetStreamPriorityRange(int* last, int* first) {
  return *last = *first = 0, cudaSuccess;
}
inline cudaError_t cudaStreamCreateWithPriority(cudaStream_t* stream, unsigned, int) {
  return *stream = nullptr, cudaSuccess;
}
inline cudaError_t cudaStreamDestroy(cudaStream_t) {
  return cudaSuccess;
}
inline cudaError_t cudaStreamSynchronize(cudaStream_t) {
  return cudaSuccess;
}
inline cudaError_t cudaGetLastError() {
  return cudaSuccess;
}
inline cudaError_t cudaPeekAtLastError() {
  return cudaSuccess;
}
inline const char* cudaGetErrorString(cudaError_t) {
  return "error of the emulator";
}
inline cudaError_t cudaMemPoolTrimTo(cudaMemPool_t, size_t) {
  return cudaSuccess;
}
inline cudaError_t cudaMemPoolGetAttribute(cudaMemPool_t, cudaMemPoolAttr, void* value) {
  return std::memset(value, 0, sizeof(uint64_t)), cudaSuccess;
}
inline cudaError_t cudaMemGetInfo(size_t* have, size_t* all) {
  return *have = *all = size_t{4} << 30, cudaSuccess;
}

// New memory is filled, so that it holds no zeros by chance.
inline cudaError_t cudaMallocAsync(void** p, size_t bytes, cudaStream_t) {
  if (bytes > size_t{16} << 30 || (*p = std::malloc(bytes)) == nullptr) return cudaErrorMemoryAllocation;
  std::memset(*p, 0xcd, bytes);
  return cudaSuccess;
}
inline cudaError_t cudaFreeAsync(void* p, cudaStream_t) {
  return std::free(p), cudaSuccess;
}
inline cudaError_t cudaMallocManaged(void** p, size_t bytes) {
  return cudaMallocAsync(p, bytes, nullptr);
}
inline cudaError_t cudaFree(void* p) {
  return cudaFreeAsync(p, nullptr);
}
inline cudaError_t cudaDeviceSynchronize() {
  return cudaSuccess;
}
inline cudaError_t cudaMallocHost(void** p, size_t bytes) {
  return cudaMallocAsync(p, bytes, nullptr);
}
inline cudaError_t cudaFreeHost(void* p) {
  return std::free(p), cudaSuccess;
}
inline cudaError_t cudaDeviceReset() {
  return cudaSuccess;
}
// There are no graphs: lists of kernels are launched one by one.
inline cudaError_t cudaGraphCreate(cudaGraph_t*, unsigned) {
  return cudaErrorNotSupported;
}
inline cudaError_t cudaGraphDestroy(cudaGraph_t) {
  return cudaErrorNotSupported;
}
inline cudaError_t cudaGraphAddKernelNode(cudaGraphNode_t*, cudaGraph_t, const cudaGraphNode_t*, size_t,
                                          const cudaKernelNodeParams*) {
  return cudaErrorNotSupported;
}
inline cudaError_t cudaGraphKernelNodeSetAttribute(cudaGraphNode_t, cudaLaunchAttributeID,
                                                   const cudaLaunchAttributeValue*) {
  return cudaErrorNotSupported;
}
inline cudaError_t cudaGraphAddDependencies(cudaGraph_t, const cudaGraphNode_t*, const cudaGraphNode_t*,
                                            const cudaGraphEdgeData*, size_t) {
  return cudaErrorNotSupported;
}
inline cudaError_t cudaGraphInstantiate(cudaGraphExec_t*, cudaGraph_t, unsigned long long) {
  return cudaErrorNotSupported;
}
inline cudaError_t cudaGraphExecDestroy(cudaGraphExec_t) {
  return cudaErrorNotSupported;
}
inline cudaError_t cudaGraphExecKernelNodeSetParams(cudaGraphExec_t, cudaGraphNode_t, const cudaKernelNodeParams*) {
  return cudaErrorNotSupported;
}
inline cudaError_t cudaGraphLaunch(cudaGraphExec_t, cudaStream_t) {
  return cudaErrorNotSupported;
}
enum { cudaEventDisableTiming = 2 };
inline cudaError_t cudaEventCreateWithFlags(cudaEvent_t* event, unsigned) {
  return *event = nullptr, cudaSuccess;
}
inline cudaError_t cudaEventDestroy(cudaEvent_t) {
  return cudaSuccess;
}
inline cudaError_t cudaEventRecord(cudaEvent_t, cudaStream_t) {
  return cudaSuccess;
}
inline cudaError_t cudaEventSynchronize(cudaEvent_t) {
  return cudaSuccess;
}
inline cudaError_t cudaStreamWaitEvent(cudaStream_t, cudaEvent_t, unsigned) {
  return cudaSuccess;
}
enum { cudaHostRegisterPortable = 1 };
inline cudaError_t cudaHostRegister(void*, size_t, unsigned) {
  return cudaSuccess;
}
inline cudaError_t cudaHostUnregister(void*) {
  return cudaSuccess;
}
inline cudaError_t cudaMemcpyAsync(void* to, const void* from, size_t bytes, cudaMemcpyKind, cudaStream_t) {
  return std::memmove(to, from, bytes), cudaSuccess;
}
inline cudaError_t cudaMemsetAsync(void* to, int byte, size_t bytes, cudaStream_t) {
  return std::memset(to, byte, bytes), cudaSuccess;
}
template <typename Kernel>
cudaError_t cudaFuncSetAttribute(Kernel, cudaFuncAttribute, int) {
  return cudaSuccess;
}
template <typename Kernel>
cudaError_t cudaOccupancyMaxActiveBlocksPerMultiprocessor(int* blocks, Kernel, int, size_t) {
  return *blocks = 1, cudaSuccess;
}
