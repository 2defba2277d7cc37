// Launches the coverage pass, the first kernel of scatter blending and of the A-buffer, and the span kernels behind it.
// Included by .cu files only.
#pragma once

#include "cuda/coverage/coverage_pass.cuh"
#include "cuda/coverage/emit_spans.cuh"
#include "cuda/device/device_caps.h"
#include "cuda/device/launch.cuh"
#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {

// Runs the coverage pass over the slab's triangles with an output `sink`. Other than small triangles are appended to
// the queues, whose lengths are in state.counters. kBlend, kPool: `blend` has the target; `by_id`: the value is the
// triangle's id. `fragments`: FragmentSlots, cleared first, or null.
absl::Status FindAllCells(RunState& state, CellSink sink, uint64_t* fragments, const InPlaceArgs* blend = nullptr,
                          bool by_id = false, const BrickPool* pool = nullptr);
// The same for the A-buffer: writes records and counts their fragments in state.a_buffer.fragment_first and behind the
// counters, as described by `counts`.
absl::Status FindAndCountCells(RunState& state, FragmentCounts& counts);

// Clears the queue counters, and `fragments` as in FindAllCells, and sizes the queues for all triangles.
absl::Status PrepareQueues(RunState& state, const uint64_t* fragments);

// The triangles [begin, end) deferred by FindAllCells.
RestArgs MakeRestArgs(const RunState& state, uint64_t begin, uint64_t end, bool repeats);

// Number of blocks of EmitRest.
inline unsigned RestBlocks(const RunState& state) {
  const uint64_t most = std::max<uint64_t>(state.mesh.host_view.triangle_count, 1);
  return unsigned(std::min<uint64_t>(uint64_t(state.device.multiprocessors) * kRestBlocks, (most + 3) / 4));
}
// The slab's span list, with its length in state.counters[kSpans].
inline SpanList ListOf(RunState& state) {
  SpanList list;
  list.spans = state.lists.spans.data();
  list.capacity = state.lists.spans.size();
  const uint64_t own = uint64_t{RestBlocks(state)} * (kRestThreads / 32) * kOwnSpans;
  if (own <= list.capacity / 4) list.own = own;
  list.count = state.counters.data() + kSpans;
  return list;
}

// Passes the rows of the large queue to a writer.
template <typename Writer>
absl::Status EmitLargeQueue(const RunState& state, const RestArgs& args, const typename Writer::Args& out) {
  constexpr int kRoom = kSetupsOfBlock * int(sizeof(SharedSetup));
  static_assert(kRoom <= 48 << 10);  // more needs an opt-in
  LaunchEarly(BeginsEarly(state.device), state.stream, unsigned(state.device.multiprocessors) * 6, kRestThreads, kRoom,
              EmitLarge<Writer>, args, out);
  VOXELPIPE_LAUNCHED_OR_RETURN("EmitLarge");
  return absl::OkStatus();
}

// Passes the rows of all deferred triangles to a writer.
template <typename Writer>
absl::Status EmitWaiting(const RunState& state, const RestArgs& args, const typename Writer::Args& out) {
  constexpr int kRoom = kRestThreads / 32 * kSetupsOfWarp * int(sizeof(SharedSetup));
  static_assert(kRoom <= 48 << 10);  // more needs an opt-in
  LaunchEarly(BeginsEarly(state.device), state.stream, RestBlocks(state), kRestThreads, kRoom, EmitRest<Writer>, args,
              out);
  VOXELPIPE_LAUNCHED_OR_RETURN("EmitRest");
  return EmitLargeQueue<Writer>(state, args, out);
}

}  // namespace voxelpipe::cuda
