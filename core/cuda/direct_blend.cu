// Blending without tiles: targets whose value is the same for all fragments of a triangle.
//
// Triangles are walked once, into a list of spans; then each target takes the list. Spans that are too many for the
// list are made and taken in parts, by halves of the triangles. Everything else goes by tiles.
#include <algorithm>
#include <utility>

#include "cuda/launch.h"
#include "cuda/run_state.h"
#include "cuda/span_blend.cuh"
#include "cuda/span_kernels.cuh"
#include "grid/index_space.h"

namespace voxelpipe::cuda {
namespace {

// Bytes of the device's memory for each span that the list may hold at most.
constexpr uint64_t kMemoryPerSpan = 64;

// Whether a dense target's blend is one atomic on its stored cells, beginning from the clear value.
bool IsInPlace(const CudaTarget& target) {
  if (target.clear_stored != 0) return false;
  const bool u32 = target.format == VoxelFormat::kU32, f32 = target.format == VoxelFormat::kF32;
  if (target.blend == Blend::kMin || target.blend == Blend::kMax) return u32 || f32;
  return u32 && (target.blend == Blend::kOr || target.blend == Blend::kCount);
}

bool IsSum(Kept kept) {
  return kept == Kept::kSum || kept == Kept::kAverage;
}

unsigned BlendBlocks(const RunState& state, uint64_t work) {
  return BlocksFor(work, kBlendThreads, uint64_t(state.device.multiprocessors) * 16);
}

// Shaders that are asked for much have a kernel of their own, which keeps nothing in local memory.
auto ShadeKernel(FragmentShaderId shader) {
  switch (shader) {
    case FragmentShaderId::kTriangleId: return ShadeTriangles<int(FragmentShaderId::kTriangleId)>;
    case FragmentShaderId::kNormal: return ShadeTriangles<int(FragmentShaderId::kNormal)>;
    case FragmentShaderId::kGeometricNormal: return ShadeTriangles<int(FragmentShaderId::kGeometricNormal)>;
    default: return ShadeTriangles<-1>;
  }
}

// The values of all triangles for a target, made once a run.
absl::Status MakeValues(RunState& state, int index) {
  const CudaTarget& target = state.targets.at[index];
  SpanTarget& memory = state.span_targets[size_t(index)];
  if (memory.shaded) return absl::OkStatus();
  ShadeTrianglesArgs args;
  args.shading.mesh = state.mesh.view.data();
  args.shading.targets[0].target = target;
  args.shading.targets[0].kept = KeptBy(target);
  args.shading.targets[0].is_float = target.format == VoxelFormat::kF16 || target.format == VoxelFormat::kF32;
  args.shading.target_count = 1;
  args.shading.traits = TraitsOf(target.shader);
  args.triangles = state.mesh.host_view.triangle_count;
  memory.shaded = true;
  if (target.blend == Blend::kCount || args.triangles == 0) return absl::OkStatus();
  const uint64_t count = args.triangles * uint64_t(target.components);
  if (IsSum(KeptBy(target))) {
    VOXELPIPE_OK_OR_RETURN(memory.terms.Resize(count, state.stream));
    args.terms = memory.terms.data();
  } else {
    VOXELPIPE_OK_OR_RETURN(memory.values.Resize(count, state.stream));
    VOXELPIPE_OK_OR_RETURN(memory.negative.Resize(1, state.stream));
    VOXELPIPE_OK_OR_RETURN(memory.negative.Fill(0, state.stream));
    args.values = memory.values.data();
    args.negative = memory.negative.data();
  }
  const auto kernel = ShadeKernel(target.shader);
  kernel<<<unsigned((args.triangles + kBlendThreads - 1) / kBlendThreads), kBlendThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ShadeTriangles");
  return absl::OkStatus();
}

// So many spans a list holds at most.
uint64_t MostSpans(const RunState& state) {
  return std::max<uint64_t>(state.device.memory_bytes / kMemoryPerSpan, 1 << 10);
}

// Whether a grid's voxels and the mesh's triangles have numbers that a span can hold.
bool SpansReach(const RunState& state, const int64_t (&dims)[3]) {
  const uint64_t rows = uint64_t(dims[1]) * uint64_t(dims[2]);
  return (uint64_t(dims[0]) + 31) / 32 * 32 <= kMostSpanBits / rows &&
         state.host.view.triangle_count <= kMostSpanTriangles;
}

// Lists the spans of triangles [begin, end) of the slab in state.spans, as far as there is room; state.counters[kSpans]
// has how many entries they need. Sets the voxels of all of them in the coverage. `count_fragments`: adds to the slots
// behind the counters.
absl::Status ListSpans(RunState& state, uint64_t begin, uint64_t end, bool count_fragments) {
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kQueued0, kQueued1, kSpans}));
  SpanArgs args;
  args.walk.grid = state.view;
  args.walk.coverage = state.request.request.coverage;
  args.walk.triangles = state.mesh.triangle_list();
  args.walk.positions = state.mesh.index_positions.data();
  args.walk.codes = state.mesh.codes.data();
  args.walk.triangle_count = end - begin;
  args.walk.rest_queue = state.queue[1].data();
  args.walk.large_queue = state.queue[2].data();
  args.walk.queued = state.counters.data() + kQueued0;
  args.world = state.mesh.host_view.positions;
  const Vec3d &origin = state.grid.origin, &size = state.grid.voxel_size;
  args.fixed = MakeFixedPlace(origin, size, WorldToIndex(origin, size, state.box.min),
                              WorldToIndex(origin, size, state.box.max));
  args.spans = state.spans.data();
  args.capacity = state.spans.size();
  args.first_triangle = begin;
  args.end_triangle = end;
  args.count = state.counters.data() + kSpans;
  args.bits = state.coverage.data();
  args.fragments = count_fragments ? state.counters.data() + kCounters : nullptr;
  const int64_t* const d = state.view.dims;
  const double surface = double(d[0]) * double(d[1]) + double(d[1]) * double(d[2]) + double(d[2]) * double(d[0]);
  args.look_first = double(end - begin) > 16 * surface;
  const auto processors = unsigned(state.device.multiprocessors);
  const auto emit = args.walk.coverage == Coverage::kThin ? EmitSpans<true> : EmitSpans<false>;
  emit<<<unsigned((end - begin + kTrianglesOfEmitBlock - 1) / kTrianglesOfEmitBlock), kEmitThreads, 0, state.stream>>>(
      args);
  VOXELPIPE_LAUNCHED_OR_RETURN("EmitSpans");
  constexpr int kOfRest = kRestThreads / 32 * kSetupsOfWarp * int(sizeof(SharedSetup));
  EmitRest<<<unsigned(std::min<uint64_t>(processors * 6, (end - begin + 3) / 4)), kRestThreads, kOfRest,
             state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("EmitRest");
  constexpr int kOfLarge = kSetupsOfBlock * int(sizeof(SharedSetup));
  EmitLarge<<<processors * 6, kRestThreads, kOfLarge, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("EmitLarge");
  return absl::OkStatus();
}

Ranks RanksOf(RunState& state) {
  Ranks ranks;
  ranks.bits = state.coverage.data();
  ranks.first = state.word_ranks.data();
  ranks.by_bricks = state.request.request.result == ResultKind::kSparse;
  ranks.more = ranks.by_bricks && !state.inside.empty() ? state.inside.data() : nullptr;
  return ranks;
}

Accumulators AccumulatorsOf(const CudaTarget& target, SpanTarget& memory) {
  Accumulators to;
  to.kept = KeptBy(target);
  to.components = target.components;
  to.cells = memory.cells.data();
  to.sums = memory.sums.data();
  to.counts = memory.counts.data();
  return to;
}

// Accumulators for `voxels` voxels, set to where blending starts.
absl::Status BeginAccumulators(RunState& state, const CudaTarget& target, SpanTarget& memory, uint64_t voxels) {
  const Kept kept = KeptBy(target);
  const uint64_t cells = voxels * uint64_t(target.components);
  if (kept == Kept::kCount || kept == Kept::kAverage) {
    VOXELPIPE_OK_OR_RETURN(memory.counts.Resize(voxels, state.stream));
    VOXELPIPE_OK_OR_RETURN(memory.counts.Fill(0, state.stream));
    if (kept == Kept::kCount) return absl::OkStatus();
  }
  if (IsSum(kept)) {
    VOXELPIPE_OK_OR_RETURN(memory.sums.Resize(cells, state.stream));
    return memory.sums.Fill(0, state.stream);
  }
  VOXELPIPE_OK_OR_RETURN(memory.cells.Resize(cells, state.stream));
  return memory.cells.Fill(kept == Kept::kMin || kept == Kept::kAnd ? 0xff : 0, state.stream);
}

// Takes the `count` spans of the list to a target.
absl::Status Take(RunState& state, int index, uint64_t count) {
  const CudaTarget& target = state.targets.at[index];
  SpanTarget& memory = state.span_targets[size_t(index)];
  if (memory.in_place) {
    InPlaceArgs args;
    args.spans = state.spans.data();
    args.count = count;
    args.values = memory.values.data();
    args.negative = target.format == VoxelFormat::kF32 ? memory.negative.data() : nullptr;
    args.out = reinterpret_cast<uint32_t*>(target.dense);
    args.blend = target.blend == Blend::kMin     ? InPlace::kMaxOfComplement
                 : target.blend == Blend::kMax   ? InPlace::kMax
                 : target.blend == Blend::kCount ? InPlace::kCount
                                                 : InPlace::kOr;
    args.planar = state.targets.planar;
    args.voxels = state.slab_voxels();
    args.nx = uint32_t(state.view.dims[0]);
    args.words_per_row = uint32_t(state.view.words_per_row);
    const auto kernel = target.components == 1   ? BlendInPlace<1>
                        : target.components == 2 ? BlendInPlace<2>
                        : target.components == 3 ? BlendInPlace<3>
                                                 : BlendInPlace<4>;
    kernel<<<BlendBlocks(state, count), kBlendThreads, 0, state.stream>>>(args);
    VOXELPIPE_LAUNCHED_OR_RETURN("BlendInPlace");
    return absl::OkStatus();
  }
  AccumulateArgs args;
  args.spans = state.spans.data();
  args.count = count;
  args.values = memory.values.data();
  args.terms = memory.terms.data();
  args.ranks = RanksOf(state);
  args.to = AccumulatorsOf(target, memory);
  const auto kernel = target.components == 1   ? Accumulate<1>
                      : target.components == 2 ? Accumulate<2>
                      : target.components == 3 ? Accumulate<3>
                                               : Accumulate<4>;
  kernel<<<BlendBlocks(state, count), kBlendThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("Accumulate");
  return absl::OkStatus();
}

bool BySpans(const CudaTarget& target) {
  return target.format != VoxelFormat::kBit;
}

// Ranks of the covered voxels of a dense result.
absl::Status Rank(RunState& state) {
  const uint64_t words = state.slab_words();
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kRanks}));
  VOXELPIPE_OK_OR_RETURN(state.word_ranks.Resize(words, state.stream));
  RankWords<<<BlocksFor(words, kBlendThreads * kRankedOfThread, UINT32_MAX), kBlendThreads, 0, state.stream>>>(
      state.coverage.data(), words, state.word_ranks.data(), state.counters.data() + kRanks);
  VOXELPIPE_LAUNCHED_OR_RETURN("RankWords");
  return absl::OkStatus();
}

absl::StatusOr<uint64_t> ListedSpans(RunState& state) {
  const auto counters = ReadCounters(state);
  if (!counters.ok()) return counters.status();
  return (*counters)[kSpans];
}

// Calls take(number of spans in the list) for lists that together hold the spans of triangles [begin, end). `counted`:
// the list is theirs, as far as there was room, and there are so many.
template <typename Take>
absl::Status ForEachList(RunState& state, uint64_t begin, uint64_t end, uint64_t counted, const Take& take) {
  while (counted > state.spans.size() && (counted <= MostSpans(state) || end - begin == 1)) {
    state.spans.Free();
    VOXELPIPE_OK_OR_RETURN(state.spans.Resize(counted + counted / 16 + 1024, state.stream));
    VOXELPIPE_OK_OR_RETURN(ListSpans(state, begin, end, false));
    const absl::StatusOr<uint64_t> again = ListedSpans(state);
    if (!again.ok()) return again.status();
    counted = *again;
  }
  if (counted <= state.spans.size()) return take(counted);
  const uint64_t middle = begin + (end - begin) / 2;
  for (const auto& [from, to] : {std::pair(begin, middle), std::pair(middle, end)}) {
    VOXELPIPE_OK_OR_RETURN(ListSpans(state, from, to, false));
    const absl::StatusOr<uint64_t> here = ListedSpans(state);
    if (!here.ok()) return here.status();
    VOXELPIPE_OK_OR_RETURN(ForEachList(state, from, to, *here, take));
  }
  return absl::OkStatus();
}

// Takes all spans to all targets.
absl::Status TakeAll(RunState& state) {
  return ForEachList(state, 0, state.mesh.host_view.triangle_count, state.span_count, [&](uint64_t count) {
    for (int i = 0; i < state.targets.count; ++i) {
      if (BySpans(state.targets.at[i])) VOXELPIPE_OK_OR_RETURN(Take(state, i, count));
    }
    return absl::OkStatus();
  });
}

absl::Status StoreKeys(RunState& state, const CudaTarget& target, SpanTarget& memory) {
  const bool is_float = target.format == VoxelFormat::kF32;
  if (target.blend != Blend::kMin && (target.blend != Blend::kMax || !is_float)) return absl::OkStatus();
  KeyArgs keys;
  keys.coverage = state.coverage.data();
  keys.negative = is_float ? memory.negative.data() : nullptr;
  keys.out = reinterpret_cast<uint32_t*>(target.dense);
  keys.words = state.slab_words();
  keys.voxels = state.slab_voxels();
  keys.nx = state.view.dims[0];
  keys.words_per_row = state.view.words_per_row;
  keys.components = target.components;
  keys.planar = state.targets.planar;
  keys.complement = target.blend == Blend::kMin;
  keys.is_float = is_float;
  KeysToValues<<<BlendBlocks(state, keys.words), kBlendThreads, 0, state.stream>>>(keys);
  VOXELPIPE_LAUNCHED_OR_RETURN("KeysToValues");
  return absl::OkStatus();
}

absl::Status Store(RunState& state, const CudaTarget& target, SpanTarget& memory, uint8_t* out, uint64_t voxels) {
  StoreArgs args;
  args.ranks = RanksOf(state);
  args.from = AccumulatorsOf(target, memory);
  args.format = target.format;
  args.is_float = target.format == VoxelFormat::kF16 || target.format == VoxelFormat::kF32;
  args.planar = state.targets.planar;
  args.quantum = target.quantum;
  args.words = state.slab_words();
  args.voxels = voxels;
  args.nx = uint32_t(state.view.dims[0]);
  args.words_per_row = uint32_t(state.view.words_per_row);
  args.out = out;
  args.all = args.ranks.by_bricks && args.ranks.more == nullptr;
  StoreAccumulated<<<BlendBlocks(state, args.words), kBlendThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("StoreAccumulated");
  return absl::OkStatus();
}

}  // namespace

bool BlendsDirectly(const RunState& state, const GridSpec& grid) {
  const VoxelizeRequest& request = state.request.request;
  if (request.result == ResultKind::kBuckets) return false;
  if (!SpansReach(state, {grid.dims[0], grid.dims[1], grid.dims[2]})) return false;
  bool any = false;
  for (size_t i = 0; i < request.targets.size(); ++i) {
    const CudaTarget target = DescribeTarget(request.targets[i], state.request.fragment_shaders[i]);
    if (target.is_occupancy) continue;
    if (target.format == VoxelFormat::kBit || !IsUniform(state, target)) return false;
    any = true;
  }
  return any;
}

absl::Status BlendDirectly(RunState& state) {
  uint64_t* const slots = state.counters.data() + kCounters;
  const uint64_t triangles = state.mesh.host_view.triangle_count;
  const bool sparse = state.request.request.result == ResultKind::kSparse;
  VOXELPIPE_CUDA_OR_RETURN(cudaMemsetAsync(slots, 0, kFragmentSlots * sizeof(uint64_t), state.stream));
  state.span_count = 0;
  if (triangles == 0) return absl::OkStatus();
  for (int i = 1; i < 3; ++i) VOXELPIPE_OK_OR_RETURN(state.queue[i].Resize(triangles, state.stream));
  bool ranked = false;
  for (int i = 0; i < state.targets.count; ++i) {
    const CudaTarget& target = state.targets.at[i];
    if (!BySpans(target)) continue;
    VOXELPIPE_OK_OR_RETURN(MakeValues(state, i));
    state.span_targets[size_t(i)].in_place = !sparse && IsInPlace(target);
    ranked = ranked || !state.span_targets[size_t(i)].in_place;
  }
  const uint64_t guess = std::min(MostSpans(state), 3 * triangles + (uint64_t{1} << 18));
  if (state.spans.size() < guess) VOXELPIPE_OK_OR_RETURN(state.spans.Resize(guess, state.stream));
  VOXELPIPE_OK_OR_RETURN(ListSpans(state, 0, triangles, true));
  if (ranked && !sparse) VOXELPIPE_OK_OR_RETURN(Rank(state));
  const auto counters = ReadCounters(state);
  if (!counters.ok()) return counters.status();
  state.span_count = (*counters)[kSpans];
  if (sparse) return absl::OkStatus();  // the bricks come first
  for (int i = 0; i < state.targets.count; ++i) {
    SpanTarget& memory = state.span_targets[size_t(i)];
    if (!BySpans(state.targets.at[i]) || memory.in_place) continue;
    VOXELPIPE_OK_OR_RETURN(BeginAccumulators(state, state.targets.at[i], memory, (*counters)[kRanks]));
  }
  VOXELPIPE_OK_OR_RETURN(TakeAll(state));
  for (int i = 0; i < state.targets.count; ++i) {
    const CudaTarget& target = state.targets.at[i];
    SpanTarget& memory = state.span_targets[size_t(i)];
    if (!BySpans(target)) continue;
    VOXELPIPE_OK_OR_RETURN(memory.in_place ? StoreKeys(state, target, memory)
                                           : Store(state, target, memory, target.dense, state.slab_voxels()));
  }
  return absl::OkStatus();
}

absl::Status BlendIntoBricks(RunState& state) {
  const uint64_t voxels = state.result.listed_voxels;
  if (state.span_count == 0) return absl::OkStatus();
  for (int i = 0; i < state.targets.count; ++i) {
    if (!BySpans(state.targets.at[i])) continue;
    VOXELPIPE_OK_OR_RETURN(BeginAccumulators(state, state.targets.at[i], state.span_targets[size_t(i)], voxels));
  }
  VOXELPIPE_OK_OR_RETURN(TakeAll(state));
  for (int i = 0; i < state.targets.count; ++i) {
    const CudaTarget& target = state.targets.at[i];
    if (!BySpans(target)) continue;
    VOXELPIPE_OK_OR_RETURN(
        Store(state, target, state.span_targets[size_t(i)], state.result.targets[size_t(i)].data(), voxels));
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
