// The sort-last pipeline: the A-buffer, that is, all fragments of each voxel.
//
// Source: J. Pantaleoni, "VoxelPipe", HPG 2011, section 4 (bucketing): fragments are counted, allocated by a scan,
// emitted and sorted by voxel; runs of equal voxels become buckets. Differences: fragments are emitted in triangle
// order and sorted stably by only as many bits as the slab's voxel indices have, so each bucket is in order of triangle
// ids; and fragments of one voxel by triangles with nearby ids may be sorted as one group (fragment_group.h).
#include <cub/device/device_select.cuh>

#include <algorithm>
#include <bit>
#include <numeric>
#include <optional>
#include <span>

#include "cuda/a_buffer/emit_groups.cuh"
#include "cuda/a_buffer/emit_records.cuh"
#include "cuda/a_buffer/group_plan.h"
#include "cuda/a_buffer/resolve.h"
#include "cuda/coverage/coverage_pass.h"
#include "cuda/device/async_readback.h"
#include "cuda/device/device.h"
#include "cuda/device/device_caps.h"
#include "cuda/device/launch.cuh"
#include "cuda/primitives/list_sizes.h"
#include "cuda/primitives/scan.h"
#include "cuda/run/bucket_views.h"
#include "cuda/run/run_state.h"
#include "cuda/shading/shade_list.h"
#include "cuda/traversal/mesh_locality.h"
#include "pipeline/plan/plan.h"

namespace voxelpipe::cuda {
namespace {

FragmentList ListOfFragments(const RunState& state) {
  const Fragments& fragments = state.a_buffer.fragments;
  FragmentList list;
  list.keys = fragments.keys[fragments.current].data();
  list.triangles = fragments.triangles[fragments.current].data();
  list.count = fragments.count;
  return list;
}

absl::Status Compact(RunState& state, const uint32_t* from, const uint8_t* flags, uint32_t* to, uint64_t* count) {
  size_t scratch = 0;
  VOXELPIPE_CUDA_OR_RETURN(cub::DeviceSelect::Flagged(nullptr, scratch, from, flags, to, count,
                                                      state.a_buffer.fragments.count, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.scratch.Resize(std::max<size_t>(scratch, 1), state.stream));
  VOXELPIPE_CUDA_OR_RETURN(cub::DeviceSelect::Flagged(state.scratch.data(), scratch, from, flags, to, count,
                                                      state.a_buffer.fragments.count, state.stream));
  return absl::OkStatus();
}

// Removes the fragments that the shaders of all targets discard.
absl::Status DropDiscarded(RunState& state) {
  DeviceArray<uint8_t> kept;
  VOXELPIPE_OK_OR_RETURN(kept.Resize(state.a_buffer.fragments.count, state.stream));
  VOXELPIPE_OK_OR_RETURN(FindKept(state, ListOfFragments(state), kept.data()));
  Fragments& fragments = state.a_buffer.fragments;
  const int from = fragments.current, to = 1 - from;
  uint64_t* const count = state.counters.data() + kScratch0;
  VOXELPIPE_OK_OR_RETURN(Compact(state, fragments.keys[from].data(), kept.data(), fragments.keys[to].data(), count));
  VOXELPIPE_OK_OR_RETURN(
      Compact(state, fragments.triangles[from].data(), kept.data(), fragments.triangles[to].data(), count));
  const absl::StatusOr<uint64_t> left = ReadElement(count, state.stream);
  if (!left.ok()) return left.status();
  fragments.count = *left;
  fragments.current = to;
  return absl::OkStatus();
}

FragmentArgs MakeFragmentArgs(RunState& state, const FragmentCounts& counts) {
  FragmentArgs args;
  args.grid = state.view;
  args.cells = state.lists.cells.data();
  args.blocks = state.lists.blocks.data();
  args.triangles = state.mesh.host_view.triangle_count;
  args.counts = counts;
  args.keys = state.a_buffer.fragments.keys[0].data();
  args.values = state.a_buffer.fragments.triangles[0].data();
  args.room = state.a_buffer.fragments.triangles[0].size();
  args.list = ListOf(state);
  // Spans cannot encode the ids: rows are rasterized twice.
  if (args.triangles > GetSpanLimits().triangles) args.list.capacity = args.list.own = 0;
  return args;
}

absl::Status LaunchEmitCells(RunState& state, FragmentArgs args) {
  VOXELPIPE_OK_OR_RETURN(state.a_buffer.bucket_chunks.Resize(ChunksOf(args.room), state.stream));
  args.clear = state.a_buffer.bucket_chunks.data();
  args.clear_count = state.a_buffer.bucket_chunks.size();
  const uint64_t chunks = (args.triangles + args.counts.of_chunk - 1) / args.counts.of_chunk;
  LaunchEarly(BeginsEarly(state.device), state.stream, unsigned(chunks), kChunkThreads, EmitCells, args);
  VOXELPIPE_LAUNCHED_OR_RETURN("EmitCells");
  return absl::OkStatus();
}

uint64_t BundleBlocks(const RunState& state) {
  const uint64_t each = uint64_t{state.a_buffer.fragments.plan->rounds} * kChunkWarps * kBundledTriangles;
  return (state.mesh.host_view.triangle_count + each - 1) / each;
}

// Clears the block sums of EmitBundles.
absl::Status ClearBundleBlocks(RunState& state) {
  VOXELPIPE_OK_OR_RETURN(state.a_buffer.bundles_before.Resize(BundleBlocks(state), state.stream));
  return state.a_buffer.bundles_before.Fill(0, state.stream);
}

// Decides whether and how fragments are grouped; if so, clears the block sums of EmitBundles.
absl::Status BeginBundles(RunState& state) {
  std::optional<BundlePlan>& plan = state.a_buffer.fragments.plan;
  plan = PlanBundles(state);
  if (!plan) return absl::OkStatus();
  // Iterations per warp that leave the smallest tail in the last wave of blocks.
  const uint64_t resident = uint64_t(state.device.multiprocessors) * kBundleBlocks;
  plan->rounds = uint32_t(RoundsFor(state.mesh.host_view.triangle_count, kChunkWarps * int(kBundledTriangles), resident,
                                    int(plan->rounds)));
  return ClearBundleBlocks(state);
}

absl::Status LaunchEmitBundles(RunState& state, const FragmentArgs& fragments) {
  EmitBundleArgs args;
  static_cast<FragmentArgs&>(args) = fragments;
  args.code = state.a_buffer.fragments.plan->code;
  args.rounds = state.a_buffer.fragments.plan->rounds;
  VOXELPIPE_OK_OR_RETURN(state.a_buffer.bucket_chunks.Resize(ChunksOfBundles(args.room), state.stream));
  args.clear = state.a_buffer.bucket_chunks.data();
  args.clear_count = state.a_buffer.bucket_chunks.size();
  args.before = state.a_buffer.bundles_before.data();
  args.bundles = state.counters.data() + kBundles;
  LaunchEarly(BeginsEarly(state.device), state.stream, unsigned(BundleBlocks(state)), kChunkThreads, EmitBundles, args);
  VOXELPIPE_LAUNCHED_OR_RETURN("EmitBundles");
  return absl::OkStatus();
}

// Emits fragments, or groups of them, of records and listed spans, up to the capacity of both lists. `bundles`:
// receives an asynchronous copy of the number of groups.
absl::Status EmitRecords(RunState& state, const FragmentArgs& args, std::optional<CounterCopy>& bundles) {
  if (state.a_buffer.fragments.plan) {
    VOXELPIPE_OK_OR_RETURN(LaunchEmitBundles(state, args));
    absl::StatusOr<CounterCopy> copy =
        CounterCopy::Start(state.counters.data() + kBundles, 1, state.device.ordinal, state.stream);
    if (!copy.ok()) return copy.status();
    bundles.emplace(*std::move(copy));
  } else {
    VOXELPIPE_OK_OR_RETURN(LaunchEmitCells(state, args));
  }
  const auto blocks = BlocksFor(args.list.capacity, kSpansOfPiece, uint64_t(state.device.multiprocessors) * 16);
  LaunchEarly(BeginsEarly(state.device), state.stream, blocks, kChunkThreads, EmitListed, args);
  VOXELPIPE_LAUNCHED_OR_RETURN("EmitListed");
  return absl::OkStatus();
}

// Allocates the predicted number of fragments before they are counted. False if the prediction exceeds its share of
// memory.
bool GuessRoom(RunState& state) {
  constexpr uint64_t kPartOfMemory = 64;
  const uint64_t most = std::min(state.device.memory_bytes, MemoryLimit()) / kPartOfMemory / (2 * sizeof(uint32_t));
  const uint64_t guess = FragmentRoom(MostOfSlab(state.expected, state.grid, state.slab.depth()).fragments);
  return guess <= most && state.a_buffer.fragments.MakeRoom(0, guess, state.stream).ok();
}

// Rasterizes every triangle once: small ones become records, the others spans. If the span list overflows, the others
// are rasterized again. If the predicted capacity suffices, the host reads the fragment count while fragments are
// emitted, so that nothing waits for it. With groups the host waits, because the sort needs the number of groups, which
// is known after emission.
absl::Status EmitByCells(RunState& state) {
  const uint64_t triangles = state.mesh.host_view.triangle_count;
  Fragments& fragments = state.a_buffer.fragments;
  VOXELPIPE_OK_OR_RETURN(BeginBundles(state));
  FragmentCounts counts;
  VOXELPIPE_OK_OR_RETURN(FindAndCountCells(state, counts));
  const uint64_t least = std::min<uint64_t>(state.device.memory_bytes / 512, SpanRoom(triangles));
  if (state.lists.spans.size() < least) VOXELPIPE_OK_OR_RETURN(state.lists.spans.Resize(least, state.stream));
  const RestArgs waiting = MakeRestArgs(state, 0, triangles, false);
  VOXELPIPE_OK_OR_RETURN(EmitWaiting<FragmentCounter>(state, waiting, MakeFragmentArgs(state, counts)));
  const absl::StatusOr<CounterCopy> copy =
      CounterCopy::Start(state.counters.data() + kSpans, kAllCounters - kSpans, state.device.ordinal, state.stream);
  if (!copy.ok()) return copy.status();
  std::optional<CounterCopy> bundles;
  const bool guessed = GuessRoom(state);
  if (guessed) VOXELPIPE_OK_OR_RETURN(EmitRecords(state, MakeFragmentArgs(state, counts), bundles));
  const absl::StatusOr<const uint64_t*> counted = copy->Wait();
  if (!counted.ok()) return counted.status();
  const uint64_t* const groups = *counted + (kCounters - kSpans) + kFragmentSlots;
  fragments.count = std::accumulate(groups, groups + kChunkGroups, uint64_t{0});
  if (fragments.count == 0) return absl::OkStatus();
  const bool too_many = fragments.plan && fragments.count > kMaxBundledFragments;
  const bool fits = guessed && !too_many && fragments.count <= fragments.triangles[0].size();
  VOXELPIPE_OK_OR_RETURN(fragments.MakeRoom(state.stream));
  const FragmentArgs args = MakeFragmentArgs(state, counts);
  if (!fits) {
    if (too_many) fragments.plan.reset();
    bundles.reset();  // no longer reads the counter
    if (fragments.plan && guessed) VOXELPIPE_OK_OR_RETURN(ClearBundleBlocks(state));
    VOXELPIPE_OK_OR_RETURN(EmitRecords(state, args, bundles));
  }
  if (fragments.plan) {
    const absl::StatusOr<const uint64_t*> bundled = bundles->Wait();
    if (!bundled.ok()) return bundled.status();
    fragments.bundles = **bundled;
  }
  const uint64_t spans = args.list.own + **counted;
  if (spans <= args.list.capacity) return absl::OkStatus();
  VOXELPIPE_OK_OR_RETURN(EmitWaiting<FragmentWriter>(state, MakeRestArgs(state, 0, triangles, true), args));
  // The next slab likely has as many spans. This slab does not use the larger list.
  const uint64_t wanted = std::min(state.device.memory_bytes / 64 / sizeof(uint64_t), spans + spans / 16);
  if (wanted > args.list.capacity) (void)state.lists.spans.Resize(wanted, state.stream);
  return absl::OkStatus();
}

// Makes buckets of fragments or groups, and sets the bit targets in `ones` to 1.
absl::Status MakeBuckets(RunState& state, uint64_t first_voxel, std::span<uint8_t* const> ones) {
  Fragments& fragments = state.a_buffer.fragments;
  BundleArgs args;
  args.keys = fragments.keys[fragments.current].data();
  args.fragments = fragments.count;
  args.first_voxel = first_voxel;
  args.first = state.a_buffer.bucket_chunks.data();
  args.offsets = state.result.offsets.data();
  args.voxels = state.result.voxels.data();
  args.listed = state.counters.data() + kBuckets;
  for (uint8_t* const words : ones) args.ones[args.ones_count++] = reinterpret_cast<uint32_t*>(words);
  if (!fragments.plan) return CountAndListBuckets(args, state.stream);
  args.code = fragments.plan->code;
  args.bundles = fragments.bundles;
  args.codes = fragments.triangles[fragments.current].data();
  fragments.current = 1 - fragments.current;
  args.triangles = fragments.triangles[fragments.current].data();
  return UnpackIntoBuckets(args, state.stream);
}

}  // namespace

absl::Status EmitFragments(RunState& state) {
  state.a_buffer.fragments.Clear();
  return state.mesh.host_view.triangle_count == 0 ? absl::OkStatus() : EmitByCells(state);
}

absl::Status SortFragments(RunState& state) {
  if (state.a_buffer.fragments.count == 0) return absl::OkStatus();
  const int bits = std::max(1, int(std::bit_width(state.slab_voxels() - 1)));
  VOXELPIPE_OK_OR_RETURN(SortFragmentList(state.a_buffer.fragments, bits, state.scratch, state.stream));
  return state.targets.any_always_present ? absl::OkStatus() : DropDiscarded(state);
}

absl::Status Resolve(RunState& state) {
  DeviceResult& out = state.result;
  const uint64_t fragments = state.a_buffer.fragments.count;
  const uint64_t most_voxels = std::min(fragments, state.slab_voxels());
  VOXELPIPE_OK_OR_RETURN(out.offsets.Resize(most_voxels + 1, state.stream));
  VOXELPIPE_OK_OR_RETURN(out.voxels.Resize(most_voxels, state.stream));
  const uint64_t first_voxel = uint64_t(state.slab.begin) * uint64_t(state.view.dims[0]) * uint64_t(state.view.dims[1]);
  uint8_t* values_of[kMaxTargets] = {};
  out.listed_fragments = fragments;
  out.targets.resize(size_t(state.targets.count));
  for (int t = 0; t < state.targets.count; ++t) {
    DeviceArray<uint8_t>& values = out.targets[size_t(t)];
    const uint64_t bytes = TargetBytes(state.request.request.targets[size_t(t)], fragments);
    VOXELPIPE_OK_OR_RETURN(values.Resize((bytes + 3) / 4 * 4, state.stream));
    values_of[t] = values.data();
  }
  if (fragments == 0) {
    const uint64_t none = 0;
    VOXELPIPE_OK_OR_RETURN(out.offsets.Upload({&none, 1}, state.stream));
    return ClearCounters(state, {kBuckets});
  }
  const bool shades = ShadesFragments(state.request);
  const std::span<uint8_t* const> ones(values_of, shades ? 0 : size_t(state.targets.count));
  VOXELPIPE_OK_OR_RETURN(MakeBuckets(state, first_voxel, ones));
  if (!shades) return absl::OkStatus();  // the values were written with the buckets
  return ShadeList(state, ListOfFragments(state), values_of);
}

}  // namespace voxelpipe::cuda
