// Handles of the CUDA runtime, and how kernels are launched.
#pragma once

#include <cstddef>

using cudaStream_t = struct EmulatedStream*;
using cudaMemPool_t = struct EmulatedPool*;
using cudaEvent_t = struct EmulatedEvent*;

struct dim3 {
  unsigned x = 1, y = 1, z = 1;
  dim3(unsigned a = 1, unsigned b = 1, unsigned c = 1) : x(a), y(b), z(c) {}
};

enum cudaLaunchAttributeID {
  cudaLaunchAttributeCooperative = 2,
  cudaLaunchAttributeProgrammaticStreamSerialization = 6
};
struct cudaLaunchAttributeValue {
  int cooperative, programmaticStreamSerializationAllowed;
};
struct cudaLaunchAttribute {
  cudaLaunchAttributeID id;
  cudaLaunchAttributeValue val;
};
struct cudaLaunchConfig_t {
  dim3 gridDim, blockDim;
  size_t dynamicSmemBytes;
  cudaStream_t stream;
  cudaLaunchAttribute* attrs;
  unsigned numAttrs;
};

using cudaGraph_t = struct EmulatedGraph*;
using cudaGraphExec_t = struct EmulatedGraphExec*;
using cudaGraphNode_t = struct EmulatedGraphNode*;
struct cudaKernelNodeParams {
  void* func;
  dim3 gridDim, blockDim;
  unsigned sharedMemBytes;
  void** kernelParams;
  void** extra;
};
enum cudaGraphDependencyType { cudaGraphDependencyTypeProgrammatic = 1 };
enum { cudaGraphKernelNodePortProgrammatic = 1 };
struct cudaGraphEdgeData {
  unsigned char from_port;
  cudaGraphDependencyType type;
};
