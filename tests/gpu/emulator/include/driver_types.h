// Handles of the CUDA runtime.
#pragma once

using cudaStream_t = struct EmulatedStream*;
using cudaMemPool_t = struct EmulatedPool*;
using cudaEvent_t = struct EmulatedEvent*;
