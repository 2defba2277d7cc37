// Launches the kernels of triangle_walk.cuh. Included by .cu files only.
#pragma once

#include <algorithm>

#include "cuda/run/run_state.h"
#include "cuda/traversal/triangle_walk.cuh"

namespace voxelpipe::cuda {

// Arguments for the current slab; sizes the queues. state.counters kQueued0 to kQueued3 must be 0.
inline absl::StatusOr<WalkArgs> MakeWalkArgs(RunState& state) {
  const uint64_t triangles = state.mesh.host_view.triangle_count;
  for (auto& queue : state.queue) {
    VOXELPIPE_OK_OR_RETURN(queue.Resize(std::max<uint64_t>(triangles, 1), state.stream));
  }
  WalkArgs args;
  args.grid = state.view;
  args.coverage = state.request.request.coverage;
  args.triangles = state.mesh.triangle_list();
  args.positions = state.mesh.index_positions.data();
  args.codes = state.mesh.codes.data();
  args.triangle_count = triangles;
  args.small_queue = state.queue[0].data();
  args.rest_queue = state.queue[1].data();
  args.large_queue = state.queue[2].data();
  args.queued = state.counters.data() + kQueued0;
  return args;
}

// Passes all triangles to an operation. An operation that repeats an earlier traversal uses the queues that it filled.
template <typename Op, typename Args>
absl::Status WalkOn(const DeviceInfo& device, cudaStream_t stream, const Args& args, const Op& op,
                    bool skip_runs = false) {
  if (args.triangle_count == 0) return absl::OkStatus();
  const auto processors = unsigned(device.multiprocessors);
  const auto blocks_for = [&](uint64_t threads, unsigned most) {
    return unsigned(std::min<uint64_t>(most, (args.triangle_count + threads - 1) / threads));
  };
  if (!skip_runs) {
    WalkRuns<<<blocks_for(kRunThreads, ~0u), kRunThreads, 0, stream>>>(args, op);
    VOXELPIPE_LAUNCHED_OR_RETURN("WalkRuns");
  }
  WalkSmall<<<blocks_for(kSmallThreads, processors * 64), kSmallThreads, 0, stream>>>(args, op);
  VOXELPIPE_LAUNCHED_OR_RETURN("WalkSmall");
  constexpr int kOfRest = kRestThreads / 32 * kSetupsOfWarp * int(sizeof(SharedSetup));
  WalkRest<<<blocks_for(4, processors * 6), kRestThreads, kOfRest, stream>>>(args, op);
  VOXELPIPE_LAUNCHED_OR_RETURN("WalkRest");
  constexpr int kOfLarge = kSetupsOfBlock * int(sizeof(SharedSetup));
  static_assert(kOfRest <= 48 << 10 && kOfLarge <= 48 << 10);  // more needs an opt-in
  WalkLarge<<<processors * 6, kRestThreads, kOfLarge, stream>>>(args, op);
  VOXELPIPE_LAUNCHED_OR_RETURN("WalkLarge");
  return absl::OkStatus();
}
template <typename Op>
absl::Status Walk(const RunState& state, const WalkArgs& args, const Op& op, bool skip_runs = false) {
  return WalkOn(state.device, state.stream, args, op, skip_runs);
}

}  // namespace voxelpipe::cuda
