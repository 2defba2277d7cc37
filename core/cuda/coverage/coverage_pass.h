// The first kernel of blending without tiles and of the A-buffer. Included by .cu files only.
#pragma once

#include "cuda/coverage/coverage_pass.cuh"
#include "cuda/coverage/emit_spans.cuh"
#include "cuda/device/device_caps.h"
#include "cuda/device/launch.cuh"
#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {

// Whether walks over the run's triangles go by fixed point; where not, all triangles wait for what comes behind the
// walk.
bool GoesByFixed(const RunState& state);

// Gives every triangle of the slab to a sink, and what is not small to the queues; state.counters has how many wait.
// kBlend, kPool: `blend` says where and how, `by_id` that the value is the triangle's id. `fragments`: FragmentSlots,
// which are cleared before; or null.
absl::Status FindAllCells(RunState& state, CellSink sink, uint64_t* fragments, const InPlaceArgs* blend = nullptr,
                          bool by_id = false, const BrickPool* pool = nullptr);
// The same, for the A-buffer: records, and how many fragments they have, in state.a_buffer.fragment_first and behind the
// counters, as `counts` then says.
absl::Status FindAndCountCells(RunState& state, FragmentCounts& counts);

// Clears the queues, and `fragments` as FindAllCells does, and makes room for all triangles to wait.
absl::Status PrepareQueues(RunState& state, const uint64_t* fragments);

// What waits after FindAllCells, of triangles [begin, end).
RestArgs MakeRestArgs(const RunState& state, uint64_t begin, uint64_t end, bool repeats);

// Blocks of EmitRest.
inline unsigned RestBlocks(const RunState& state) {
  const uint64_t most = std::max<uint64_t>(state.mesh.host_view.triangle_count, 1);
  return unsigned(std::min<uint64_t>(uint64_t(state.device.multiprocessors) * kRestBlocks, (most + 3) / 4));
}
// The list of spans, as it stands in the slab's arrays: counted by state.counters[kSpans].
inline SpanList ListOf(RunState& state) {
  SpanList list;
  list.spans = state.lists.spans.data();
  list.capacity = state.lists.spans.size();
  const uint64_t own = uint64_t{RestBlocks(state)} * (kRestThreads / 32) * kOwnSpans;
  if (own <= list.capacity / 4) list.own = own;
  list.count = state.counters.data() + kSpans;
  return list;
}

// Gives the rows of the large queue to writers.
template <typename Writer>
absl::Status EmitLargeQueue(const RunState& state, const RestArgs& args, const typename Writer::Args& out) {
  constexpr int kRoom = kSetupsOfBlock * int(sizeof(SharedSetup));
  static_assert(kRoom <= 48 << 10);  // more must be asked for
  LaunchEarly(BeginsEarly(state.device), state.stream, unsigned(state.device.multiprocessors) * 6, kRestThreads, kRoom,
              EmitLarge<Writer>, args, out);
  VOXELPIPE_LAUNCHED_OR_RETURN("EmitLarge");
  return absl::OkStatus();
}

// Gives the rows of what waits to writers.
template <typename Writer>
absl::Status EmitWaiting(const RunState& state, const RestArgs& args, const typename Writer::Args& out) {
  constexpr int kRoom = kRestThreads / 32 * kSetupsOfWarp * int(sizeof(SharedSetup));
  static_assert(kRoom <= 48 << 10);  // more must be asked for
  LaunchEarly(BeginsEarly(state.device), state.stream, RestBlocks(state), kRestThreads, kRoom, EmitRest<Writer>, args,
              out);
  VOXELPIPE_LAUNCHED_OR_RETURN("EmitRest");
  return EmitLargeQueue<Writer>(state, args, out);
}

}  // namespace voxelpipe::cuda
