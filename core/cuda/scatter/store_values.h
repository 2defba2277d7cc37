// Storage of scatter-blended targets (scatter_blend.cu) and its conversion to results. Included by .cu files only.
#pragma once

#include "cuda/coverage/accumulators.h"
#include "cuda/scatter/blend_spans.cuh"

namespace voxelpipe::cuda {

// True if the target's values are triangle ids, which need not be precomputed.
inline bool IsById(const CudaTarget& target) {
  return target.shader == FragmentShaderId::kTriangleId && target.components == 1;
}
inline unsigned BlendBlocks(const RunState& state, uint64_t work) {
  return BlocksFor(work, kBlendThreads, uint64_t(state.device.multiprocessors) * 16);
}
// Device flag that is non-zero if some value of a float target is negative, as in InPlaceArgs. Ids are never negative.
inline const uint32_t* NegativeOf(RunState& state, const SpanTarget& memory) {
  return memory.by_id ? reinterpret_cast<const uint32_t*>(state.counters.data() + kNever) : memory.negative.data();
}
// The kFragmentSlots counters.
inline uint64_t* FragmentSlots(RunState& state) {
  return state.counters.data() + kCounters;
}

// A target's accumulators and the values or terms of triangles; spans are not set.
AccumulateArgs SumsOf(RunState& state, int index);

// Stores blended values in a dense target, or bits in a bit target.
absl::Status StoreDense(RunState& state, int index);

}  // namespace voxelpipe::cuda
