// Fill by parts: the crossings of each part with the lines along x decide about its inside alone; of the parts around a
// voxel's centre the one of the highest rank owns it.
//
// Crossings are listed in one pass over the triangles and sorted by row, rank and place (part_crossings.cuh). A warp
// then sweeps a row: each part paints what is inside and not yet painted, so that every voxel is written once. Memory
// is proportional to crossings, not to parts times voxels. If a slab's do not fit, its rows are taken in ranges.
#include <algorithm>
#include <bit>
#include <vector>

#include "cuda/device/launch.cuh"
#include "cuda/fill/part_crossings.cuh"
#include "cuda/primitives/list_sizes.h"
#include "cuda/primitives/radix_sort.h"
#include "cuda/run/run_state.h"
#include "pipeline/stages/part_fill_values.h"

namespace voxelpipe::cuda {
namespace {

constexpr uint64_t kMaxCrossings = UINT32_MAX;  // of a range of rows

// The crossings of a range of rows.
struct CrossingLists {
  DeviceArray<uint64_t> keys[2];
  DeviceArray<uint32_t> begin, end;  // by row

  uint64_t capacity() const { return std::min(keys[0].size(), keys[1].size()); }
  absl::Status MakeRoom(uint64_t crossings, cudaStream_t stream) {
    for (auto& array : keys) array.Free();
    for (auto& array : keys) VOXELPIPE_OK_OR_RETURN(array.Resize(crossings, stream));
    return absl::OkStatus();
  }
  // For as many crossings as there is room for, `crossings` at most.
  absl::Status MakeSomeRoom(uint64_t crossings, cudaStream_t stream) {
    constexpr uint64_t kLeast = 1 << 10;
    for (;; crossings = std::max(kLeast, crossings / 2)) {
      absl::Status s = MakeRoom(crossings, stream);
      if (s.ok() || crossings <= kLeast) return s;
    }
  }
};

uint32_t BitsFor(uint64_t most) {
  return uint32_t(std::max(1, int(std::bit_width(most))));
}

// The values of the targets whose fill differs from part to part. Once a run.
absl::Status MakeFills(RunState& state) {
  PartState& parts = state.parts;
  if (parts.has_fills) return absl::OkStatus();
  const std::vector<RigidMotionNumbers> motions = MotionsByRank(state.host.mesh, state.request);
  for (size_t t = 0; t < state.request.request.targets.size(); ++t) {
    if (!FillsByPart(state.request, t)) continue;
    const std::vector<FillValue> fills = PartFillValues(state.request, t, state.host.view, motions, state.grid);
    VOXELPIPE_OK_OR_RETURN(parts.fills[t].Upload(fills, state.stream));
  }
  parts.has_fills = true;
  return absl::OkStatus();
}

// Lists the crossings of rows [first, end). Out: how many there are; the list is complete if it has room for them.
// Synchronizes.
absl::StatusOr<uint64_t> List(RunState& state, PartCrossingArgs& args) {
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kCrossings, kQueued0, kQueued1}));
  args.some_count = state.counters.data() + kQueued0;
  args.many_count = state.counters.data() + kQueued1;
  args.count = state.counters.data() + kCrossings;
  ListSmall<<<unsigned((args.triangle_count + kFillThreads - 1) / kFillThreads), kFillThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ListSmall");
  constexpr unsigned kShare = 8;
  const auto multiprocessors = unsigned(state.device.multiprocessors);
  ListSome<<<kShare * multiprocessors, kFillThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ListSome");
  ListMany<<<dim3(kShare, multiprocessors), kFillThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ListMany");
  const auto counters = ReadCounters(state);
  if (!counters.ok()) return counters.status();
  return (*counters)[kCrossings];
}

// Paints the listed rows.
absl::Status Sweep(RunState& state, const PartCrossingArgs& args, uint64_t count, CrossingLists& lists) {
  if (count == 0) return absl::OkStatus();
  const absl::StatusOr<int> sorted = SortKeys({lists.keys[0].data(), lists.keys[1].data()}, count, 1,
                                              int(args.code.bits()), state.scratch, state.stream);
  if (!sorted.ok()) return sorted.status();
  PartSweepArgs sweep;
  sweep.code = args.code;
  sweep.keys = lists.keys[*sorted].data();
  sweep.rows = args.end_row - args.first_row;
  for (auto* array : {&lists.begin, &lists.end}) {
    VOXELPIPE_OK_OR_RETURN(array->Resize(sweep.rows, state.stream));
    VOXELPIPE_OK_OR_RETURN(array->Fill(0, state.stream));
  }
  FindRows<<<BlocksFor(count, kFillThreads), kFillThreads, 0, state.stream>>>(sweep.code, sweep.keys, count,
                                                                              lists.begin.data(), lists.end.data());
  VOXELPIPE_LAUNCHED_OR_RETURN("FindRows");
  sweep.begin = lists.begin.data();
  sweep.end = lists.end.data();
  sweep.signs = state.request.request.fill == Fill::kNonzero;
  sweep.words_per_row = state.view.words_per_row;
  sweep.inside = state.inside.data() + args.first_row * uint64_t(sweep.words_per_row);
  sweep.ranks = state.parts.inside_ranks.data() + args.first_row * uint64_t(state.view.dims[0]);
  sweep.odd_columns = state.counters.data() + kOddColumns;
  sweep.odd_of_parts = state.parts.counts.data();
  SweepRows<<<BlocksFor(sweep.rows, kFillThreads / 32), kFillThreads, 0, state.stream>>>(sweep);
  VOXELPIPE_LAUNCHED_OR_RETURN("SweepRows");
  return absl::OkStatus();
}

}  // namespace

absl::Status FindOwners(RunState& state) {
  PartState& parts = state.parts;
  const uint64_t rows = state.slab_rows(), triangles = state.mesh.host_view.triangle_count;
  VOXELPIPE_OK_OR_RETURN(state.inside.Resize(state.slab_words(), state.stream));
  VOXELPIPE_OK_OR_RETURN(state.inside.Fill(0, state.stream));
  VOXELPIPE_OK_OR_RETURN(parts.inside_ranks.Resize(state.slab_voxels(), state.stream));
  VOXELPIPE_OK_OR_RETURN(parts.inside_ranks.Fill(0, state.stream));
  VOXELPIPE_OK_OR_RETURN(parts.counts.Resize(2 * uint64_t{parts.count}, state.stream));
  VOXELPIPE_OK_OR_RETURN(parts.counts.Fill(0, state.stream));
  if (triangles == 0) return absl::OkStatus();
  VOXELPIPE_OK_OR_RETURN(MakeFills(state));
  VOXELPIPE_OK_OR_RETURN(PlaceVertices(state));
  for (const int i : {0, 1}) VOXELPIPE_OK_OR_RETURN(state.queue[i].Resize(triangles, state.stream));
  PartCrossingArgs args;
  args.grid = state.view;
  args.code.nx = uint32_t(state.view.dims[0]);
  args.code.top_rank = parts.count - 1;
  args.code.before_bits = BitsFor(args.code.nx);
  args.code.rank_bits = BitsFor(args.code.top_rank);
  args.parts = {state.mesh.host_view.parts, state.mesh.host_view.part_count};
  args.triangles = state.mesh.triangle_list();
  args.positions = state.mesh.index_positions.data();
  args.triangle_count = triangles;
  args.some = state.queue[0].data();
  args.many = state.queue[1].data();
  CrossingLists lists;
  const Surface slab = MostOfSlab(state.expected, state.grid, state.slab.depth());
  const uint64_t guess = std::min({CrossingRoom(slab.crossings), triangles * rows, kMaxCrossings});
  VOXELPIPE_OK_OR_RETURN(lists.MakeSomeRoom(guess, state.stream));
  uint64_t at_once = rows;
  for (uint64_t row = 0; row < rows;) {
    VOXELPIPE_OK_OR_RETURN(state.job.Check());
    args.first_row = row;
    args.end_row = std::min(rows, row + at_once);
    args.code.row_bits = BitsFor(args.end_row - row - 1);
    args.keys = lists.keys[0].data();
    args.capacity = lists.capacity();
    const absl::StatusOr<uint64_t> count = List(state, args);
    if (!count.ok()) return count.status();
    if (*count > args.capacity) {
      const bool numbered = *count <= kMaxCrossings;
      const absl::Status grown = numbered ? lists.MakeRoom(*count + *count / 16, state.stream) : absl::OkStatus();
      if (numbered && grown.ok()) continue;
      if (args.end_row - row == 1) return grown;
      if (!grown.ok()) VOXELPIPE_OK_OR_RETURN(lists.MakeSomeRoom(guess, state.stream));
      at_once = (args.end_row - row + 1) / 2;
      continue;
    }
    const absl::Status swept = Sweep(state, args, *count, lists);
    if (absl::IsResourceExhausted(swept) && args.end_row - row > 1) {  // before a voxel was painted
      VOXELPIPE_OK_OR_RETURN(lists.MakeSomeRoom(args.capacity / 2, state.stream));
      at_once = (args.end_row - row + 1) / 2;
      continue;
    }
    if (!swept.ok()) return swept;
    row = args.end_row;
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
