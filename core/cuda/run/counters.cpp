// Allocates, clears and reads the device counters of a run (Counter in run_state.h).
#include <algorithm>

#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {

absl::Status EnsureCounters(RunState& state) {
  if (!state.counters.empty()) return absl::OkStatus();
  VOXELPIPE_OK_OR_RETURN(state.counters.Resize(kAllCounters, state.stream));
  return state.counters.Fill(0, state.stream);
}

absl::Status ClearCounters(RunState& state, std::initializer_list<Counter> which) {
  if (state.counters.empty()) return EnsureCounters(state);
  // Adjacent counters in one memset.
  for (auto at = which.begin(); at != which.end();) {
    auto end = at + 1;
    while (end != which.end() && *end == *(end - 1) + 1) ++end;
    VOXELPIPE_CUDA_OR_RETURN(
        cudaMemsetAsync(state.counters.data() + *at, 0, size_t(end - at) * sizeof(uint64_t), state.stream));
    at = end;
  }
  return absl::OkStatus();
}

absl::Status ClearQueues(RunState& state, int end) {
  if (state.counters.empty()) return EnsureCounters(state);
  VOXELPIPE_CUDA_OR_RETURN(
      cudaMemsetAsync(state.counters.data() + kQueued0, 0, size_t(end - kQueued0) * sizeof(uint64_t), state.stream));
  return absl::OkStatus();
}

absl::StatusOr<std::array<uint64_t, kCounters>> ReadCounters(RunState& state) {
  std::array<uint64_t, kCounters> counters{};
  if (state.counters.empty()) return counters;
  std::array<uint64_t, kCounters + kFragmentSlots> all{};
  VOXELPIPE_CUDA_OR_RETURN(
      cudaMemcpyAsync(all.data(), state.counters.data(), sizeof all, cudaMemcpyDeviceToHost, state.stream));
  VOXELPIPE_CUDA_OR_RETURN(cudaStreamSynchronize(state.stream));
  std::copy_n(all.begin(), counters.size(), counters.begin());
  if (state.plan.blends()) {
    for (size_t i = counters.size(); i < all.size(); ++i) counters[kFragments] += all[i];
  }
  return counters;
}

}  // namespace voxelpipe::cuda
