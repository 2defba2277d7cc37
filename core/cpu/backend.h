// The CPU backend: the pipeline's stages on oneTBB.
#pragma once

#include "pipeline/stages/stages.h"

namespace voxelpipe::cpu {

// Lives as long as the process. Safe to run several jobs at once, each in an arena of its own.
const Backend& CpuBackend();

}  // namespace voxelpipe::cpu
