// Where targets that are blended without tiles (scatter_blend.cu) keep what is blended, and how that becomes the result.
// Included by .cu files only.
#pragma once

#include "cuda/coverage/accumulators.h"
#include "cuda/scatter/blend_spans.cuh"

namespace voxelpipe::cuda {

// True if its values are the ids of triangles, which no kernel has to read.
inline bool IsById(const CudaTarget& target) {
  return target.shader == FragmentShaderId::kTriangleId && target.components == 1;
}
inline unsigned BlendBlocks(const RunState& state, uint64_t work) {
  return BlocksFor(work, kBlendThreads, uint64_t(state.device.multiprocessors) * 16);
}
// Whether some value of a float target is negative: as InPlaceArgs has it. No triangle's id is.
inline const uint32_t* NegativeOf(RunState& state, const SpanTarget& memory) {
  return memory.by_id ? reinterpret_cast<const uint32_t*>(state.counters.data() + kNever) : memory.negative.data();
}
// kFragmentSlots counters.
inline uint64_t* FragmentSlots(RunState& state) {
  return state.counters.data() + kCounters;
}

// A target's accumulators, and what triangles bring to them; without spans.
AccumulateArgs SumsOf(RunState& state, int index);

// What was blended becomes the values of a dense target, or the bits of a bit target.
absl::Status StoreDense(RunState& state, int index);

}  // namespace voxelpipe::cuda
