// The CPU backend: the pipeline's stages on oneTBB.
#pragma once

#include "pipeline/stages/stages.h"

namespace voxelpipe::cpu {

// A process-wide singleton. Thread-safe: several jobs may run at once, each in an arena of its own.
const Backend& CpuBackend();

}  // namespace voxelpipe::cpu
