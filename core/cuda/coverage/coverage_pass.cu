// Launches the coverage pass (FindCells) with the right kernel for its output, shader and coverage.
#include "cuda/coverage/coverage_pass.h"

#include <algorithm>

#include "cuda/device/device_caps.h"
#include "cuda/device/launch.cuh"
#include "cuda/traversal/mesh_locality.h"
#include "cuda/traversal/raster_args.h"

namespace voxelpipe::cuda {
namespace {

// `by_place`: in the spatial order, if the mesh has one; else by triangle id.
BitArgs MakeCellWalk(const RunState& state, bool by_place = false) {
  BitArgs args;
  args.grid = state.view;
  args.bits = TouchedBits(const_cast<RunState&>(state));
  args.coverage = state.request.request.coverage;
  SetTriangles(state, args);
  UsePacked(state, args, by_place);
  args.layer_queue = const_cast<uint32_t*>(state.queue[1].data());
  args.large_queue = const_cast<uint32_t*>(state.queue[2].data());
  args.queued = const_cast<uint64_t*>(state.counters.data()) + kQueued0;
  return args;
}

template <bool kThin, bool kPacked>
auto KernelFor(CellSink sink, bool by_id) {
  constexpr int kById = int(FragmentShaderId::kTriangleId);
  switch (sink) {
    case CellSink::kRecords: return FindCells<kThin, CellSink::kRecords, -1, kPacked>;
    case CellSink::kRecordsAndBits: return FindCells<kThin, CellSink::kRecordsAndBits, -1, kPacked>;
    case CellSink::kPool:
      return by_id ? FindCells<kThin, CellSink::kPool, kById, kPacked> : FindCells<kThin, CellSink::kPool, -1, kPacked>;
    default:
      return by_id ? FindCells<kThin, CellSink::kBlend, kById, kPacked>
                   : FindCells<kThin, CellSink::kBlend, -1, kPacked>;
  }
}
template <bool kThin>
auto KernelFor(const BitArgs& walk, CellSink sink, bool by_id) {
  return walk.packed != nullptr ? KernelFor<kThin, true>(sink, by_id) : KernelFor<kThin, false>(sink, by_id);
}

// Triangles per thread of FindCells.
int RoundsOf(const RunState& state) {
  return RoundsFor(state.mesh.host_view.triangle_count, kFindThreads,
                   uint64_t(state.device.multiprocessors) * kFindBlocks, kMaxFindRounds);
}

absl::Status MakeRoomForQueues(RunState& state) {
  for (int i = 1; i < 3; ++i) {
    const uint64_t most = std::max<uint64_t>(state.mesh.host_view.triangle_count, 1);
    VOXELPIPE_OK_OR_RETURN(state.queue[i].Resize(most, state.stream));
  }
  return absl::OkStatus();
}

absl::Status Find(RunState& state, CellSink sink, CellArgs& args, bool by_id) {
  const uint64_t triangles = state.mesh.host_view.triangle_count;
  const bool counts = args.chunks.of_block != nullptr;
  VOXELPIPE_OK_OR_RETURN(counts ? MakeRoomForQueues(state) : PrepareQueues(state, args.fragments));
  if (triangles == 0) return absl::OkStatus();
  if (sink == CellSink::kRecords || sink == CellSink::kRecordsAndBits) {
    VOXELPIPE_OK_OR_RETURN(state.lists.cells.Resize(triangles, state.stream));
    VOXELPIPE_OK_OR_RETURN(state.lists.blocks.Resize(triangles, state.stream));
    args.records = state.lists.cells.data();
    args.blocks = state.lists.blocks.data();
  }
  args.walk = MakeCellWalk(state, /*by_place=*/!counts);  // the A-buffer lists fragments by triangle id
  args.walk.rounds = RoundsOf(state);
  const uint64_t each = uint64_t(args.walk.rounds) * kFindThreads;
  const bool thin = args.walk.coverage == Coverage::kThin;
  const auto kernel = thin ? KernelFor<true>(args.walk, sink, by_id) : KernelFor<false>(args.walk, sink, by_id);
  kernel<<<unsigned((triangles + each - 1) / each), kFindThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("FindCells");
  return absl::OkStatus();
}

}  // namespace

absl::Status FindAllCells(RunState& state, CellSink sink, uint64_t* fragments, const InPlaceArgs* blend, bool by_id,
                          const BrickPool* pool) {
  CellArgs args;
  args.fragments = fragments;
  if (blend != nullptr) args.blend = *blend;
  if (pool != nullptr) args.pool = *pool;
  return Find(state, sink, args, by_id);
}

absl::Status PrepareQueues(RunState& state, const uint64_t* fragments) {
  VOXELPIPE_OK_OR_RETURN(ClearQueues(state, fragments != nullptr ? kCounters + kFragmentSlots : kCounters));
  return MakeRoomForQueues(state);
}

absl::Status FindAndCountCells(RunState& state, FragmentCounts& counts) {
  VOXELPIPE_OK_OR_RETURN(ClearQueues(state, kAllCounters));
  counts.of_chunk = uint32_t(RoundsOf(state)) * kFindThreads;
  const uint64_t chunks = (state.mesh.host_view.triangle_count + counts.of_chunk - 1) / counts.of_chunk;
  VOXELPIPE_OK_OR_RETURN(state.a_buffer.fragment_first.Resize(chunks, state.stream));
  counts.of_block = state.a_buffer.fragment_first.data();
  counts.of_groups = state.counters.data() + kCounters + kFragmentSlots;
  counts.chunks_of_group = uint32_t((chunks + kChunkGroups - 1) / kChunkGroups);
  CellArgs args;
  args.chunks = counts;
  return Find(state, CellSink::kRecords, args, false);
}

RestArgs MakeRestArgs(const RunState& state, uint64_t begin, uint64_t end, bool repeats) {
  RestArgs args;
  args.walk = MakeCellWalk(state);
  args.first_triangle = begin;
  args.end_triangle = end;
  args.repeats = repeats;
  return args;
}

}  // namespace voxelpipe::cuda
