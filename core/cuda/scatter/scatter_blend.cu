// Scatter blending: targets are blended without tiles or sorting, by atomics (core/cuda/README.md, "Coverage, then
// shade, then blend").
//
// Triangles are rasterized once. For Path::kInPlace and kFloat4 they are blended in the target immediately, for kBricks
// in bricks allocated on demand (brick_scatter.h). Otherwise small triangles become records and larger ones spans in a
// list, and each target reads both. If the list overflows, it is made and read in several passes, by halving the range
// of triangles.
#include <algorithm>
#include <utility>

#include "cuda/coverage/coverage_pass.h"
#include "cuda/device/launch.cuh"
#include "cuda/primitives/list_sizes.h"
#include "cuda/run/run_state.h"
#include "cuda/scatter/atomic_row_sink.cuh"
#include "cuda/scatter/blend_records.cuh"
#include "cuda/scatter/brick_scatter.h"
#include "cuda/scatter/float4_pass.h"
#include "cuda/scatter/part_owners.h"
#include "cuda/scatter/store_values.h"
#include "cuda/shading/shade_list.h"
#include "cuda/traversal/mesh_locality.h"
#include "cuda/traversal/raster_args.h"

namespace voxelpipe::cuda {
namespace {

// The span list is limited to one span per so many bytes of device memory.
constexpr uint64_t kMemoryPerSpan = 64;

// Common shaders have specialized kernels, which use no local memory.
auto ShadeKernel(FragmentShaderId shader) {
  switch (shader) {
    case FragmentShaderId::kTriangleId: return ShadeTriangles<int(FragmentShaderId::kTriangleId)>;
    case FragmentShaderId::kNormal: return ShadeTriangles<int(FragmentShaderId::kNormal)>;
    case FragmentShaderId::kGeometricNormal: return ShadeTriangles<int(FragmentShaderId::kGeometricNormal)>;
    default: return ShadeTriangles<-1>;
  }
}

// Computes the values of all triangles for a target, once per run.
absl::Status MakeValues(RunState& state, int index) {
  const CudaTarget& target = state.targets.at[index];
  SpanTarget& memory = state.span_targets[size_t(index)];
  if (memory.shaded) return absl::OkStatus();
  ShadeTrianglesArgs args;
  args.shading.mesh = state.mesh.view.data();
  args.shading.target = target;
  args.shading.kept = KeptBy(target);
  args.shading.is_float = IsFloat(target.format);
  args.shading.traits = TraitsOf(target.shader);
  args.triangles = state.mesh.host_view.triangle_count;
  args.degenerate = DegenerateTestOf(state);
  memory.shading = args.shading;
  const bool owners = state.plan.targets[size_t(index)].source == ValueSource::kOwners;
  const bool by_first_id = owners && target.blend == Blend::kFirst && !state.parts.ids_in_order;
  // A kernel knows the number of a triangle; its id is another one where parts are in an order of their own.
  memory.by_id = owners ? !by_first_id : IsById(target) && state.parts.ids_in_order;
  memory.degenerate = args.degenerate;
  if (ShadesByFours(state, target)) return absl::OkStatus();
  memory.shaded = true;
  if (target.blend == Blend::kCount || args.triangles == 0) return absl::OkStatus();
  if (memory.by_id) return EnsureCounters(state);  // for NegativeOf; computing an id is cheaper than reading it
  if (by_first_id) {
    VOXELPIPE_OK_OR_RETURN(memory.values.Resize(args.triangles, state.stream));
    return ListOwnerIds(state, memory.values.data());
  }
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
  const auto blocks = unsigned((args.triangles + kBlendThreads - 1) / kBlendThreads);
  const auto kernel = ShadeKernel(target.shader);
  kernel<<<blocks, kBlendThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ShadeTriangles");
  return absl::OkStatus();
}

// Maximum number of spans in the list.
uint64_t MostSpans(const RunState& state) {
  return std::max<uint64_t>(state.device.memory_bytes / kMemoryPerSpan, 1 << 10);
}

// Arguments to rasterize the rows of `triangles` deferred triangles.
SpanArgs CoverArgs(RunState& state, uint64_t triangles) {
  SpanArgs args;
  args.grid = state.view;
  args.bits = TouchedBits(state);
  const int64_t* const d = state.view.dims;
  const double surface = double(d[0]) * double(d[1]) + double(d[1]) * double(d[2]) + double(d[2]) * double(d[0]);
  // Deferred triangles of a fine mesh with good locality usually lie beside triangles that cover the same voxels.
  args.look_first = double(triangles) > 16 * surface || (IsFine(state) && !IsScattered(state));
  return args;
}

// Lists the spans of the deferred triangles in [begin, end) in state.lists.spans, up to its capacity; ListOf has the
// number of entries needed. Sets their coverage. `again`: the queues are no longer valid, and fragments are counted
// already.
absl::Status ListSpans(RunState& state, uint64_t begin, uint64_t end, bool again) {
  if (again) VOXELPIPE_OK_OR_RETURN(FindAllCells(state, CellSink::kRecords, nullptr));
  SpanArgs args = CoverArgs(state, end - begin);
  args.list = ListOf(state);
  args.fragments = again ? nullptr : FragmentSlots(state);
  args.first_triangle = uint32_t(begin);
  return EmitWaiting<SpanWriter>(state, MakeRestArgs(state, begin, end, false), args);
}

InPlaceArgs PlaceOf(RunState& state, int index) {
  const CudaTarget& target = state.targets.at[index];
  SpanTarget& memory = state.span_targets[size_t(index)];
  InPlaceArgs args;
  args.values = memory.values.data();
  args.shading = memory.shading;
  args.degenerate = memory.degenerate;
  args.negative = target.format == VoxelFormat::kF32 ? NegativeOf(state, memory) : nullptr;
  args.out = reinterpret_cast<uint32_t*>(target.dense);
  args.blend = target.blend == Blend::kMin     ? InPlace::kMaxOfComplement
               : target.blend == Blend::kMax   ? InPlace::kMax
               : target.blend == Blend::kCount ? InPlace::kCount
                                               : InPlace::kOr;
  if (state.plan.targets[size_t(index)].source == ValueSource::kOwners) {
    args.blend = target.blend == Blend::kFirst ? InPlace::kMaxOfComplement : InPlace::kMax;
  }
  args.planar = state.targets.planar;
  args.voxels = state.slab_voxels();
  args.nx = uint32_t(state.view.dims[0]);
  args.words_per_row = uint32_t(state.view.words_per_row);
  return args;
}

constexpr int kById = int(FragmentShaderId::kTriangleId);

// Values of a triangle that are blended.
int ValuesOfTriangle(const RunState& state, int index) {
  const CudaTarget& target = state.targets.at[index];
  return HasOwner(target) ? 1 : target.components;
}

bool IsSparse(const RunState& state) {
  return state.request.request.result == ResultKind::kSparse;
}

auto AccumulateFor(bool by_id, int components) {
  return by_id             ? Accumulate<1, kById>
         : components == 1 ? Accumulate<1, -1>
         : components == 2 ? Accumulate<2, -1>
         : components == 3 ? Accumulate<3, -1>
                           : Accumulate<4, -1>;
}
template <BlendTo kTo>
auto BlendCellsTo(bool by_id, int components) {
  return by_id             ? BlendCells<1, kById, kTo>
         : components == 1 ? BlendCells<1, -1, kTo>
         : components == 2 ? BlendCells<2, -1, kTo>
         : components == 3 ? BlendCells<3, -1, kTo>
                           : BlendCells<4, -1, kTo>;
}

// Blends listed spans into accumulators.
absl::Status AccumulateSpans(RunState& state, AccumulateArgs args, bool by_id, int components,
                             const ListedSpans& listed) {
  args.spans = state.lists.spans.data();
  args.count = listed.count;
  args.first_triangle = listed.first_triangle;
  const auto kernel = AccumulateFor(by_id, components);
  kernel<<<BlendBlocks(state, listed.count), kBlendThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("Accumulate");
  return absl::OkStatus();
}

// Blends listed spans into a target.
absl::Status TakeSpans(RunState& state, int index, const ListedSpans& listed) {
  if (listed.count == 0) return absl::OkStatus();
  const int components = ValuesOfTriangle(state, index);
  const SpanTarget& memory = state.span_targets[size_t(index)];
  if (state.plan.targets[size_t(index)].in_place) {
    InPlaceArgs args = PlaceOf(state, index);
    args.spans = state.lists.spans.data();
    args.count = listed.count;
    args.first_triangle = listed.first_triangle;
    const auto kernel = memory.by_id      ? BlendInPlace<1, kById>
                        : components == 1 ? BlendInPlace<1, -1>
                        : components == 2 ? BlendInPlace<2, -1>
                        : components == 3 ? BlendInPlace<3, -1>
                                          : BlendInPlace<4, -1>;
    kernel<<<BlendBlocks(state, listed.count), kBlendThreads, 0, state.stream>>>(args);
    VOXELPIPE_LAUNCHED_OR_RETURN("BlendInPlace");
    return absl::OkStatus();
  }
  return AccumulateSpans(state, SumsOf(state, index), memory.by_id, components, listed);
}

// The records of all triangles; where to they are blended is not set.
BlendCellsArgs RecordsOf(RunState& state) {
  BlendCellsArgs args;
  args.records = state.lists.cells.data();
  args.blocks = state.lists.blocks.data();
  args.triangles = state.mesh.host_view.triangle_count;
  args.placed = PlacedTriangles(state);
  args.grid = state.view;
  return args;
}

// Blends the records of all triangles into a target.
absl::Status TakeCells(RunState& state, int index) {
  const int components = ValuesOfTriangle(state, index);
  const SpanTarget& memory = state.span_targets[size_t(index)];
  BlendCellsArgs args = RecordsOf(state);
  const bool in_place = state.plan.targets[size_t(index)].in_place;
  if (in_place) {
    args.place = PlaceOf(state, index);
  } else {
    args.accumulate = SumsOf(state, index);
  }
  const auto kernel = in_place ? BlendCellsTo<BlendTo::kTarget>(memory.by_id, components)
                               : BlendCellsTo<BlendTo::kAccumulators>(memory.by_id, components);
  kernel<<<BlendBlocks(state, args.triangles), kBlendThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("BlendCells");
  return absl::OkStatus();
}

absl::Status ClearFragmentSlots(RunState& state) {
  VOXELPIPE_CUDA_OR_RETURN(cudaMemsetAsync(FragmentSlots(state), 0, kFragmentSlots * sizeof(uint64_t), state.stream));
  return absl::OkStatus();
}

// Rasterizes all triangles and blends them into a target immediately.
absl::Status BlendWhatIsFound(RunState& state, int index) {
  const uint64_t triangles = state.mesh.host_view.triangle_count;
  const CudaTarget& target = state.targets.at[index];
  SpanTarget& memory = state.span_targets[size_t(index)];
  const bool by_id = memory.by_id, by_fours = state.plan.path == Path::kFloat4;
  if (by_fours) memory.negative.Free();  // keys are never replaced by plain floats
  BlendWriterArgs args;
  args.cover = CoverArgs(state, triangles);
  args.cover.fragments = FragmentSlots(state);
  args.blend = PlaceOf(state, index);
  if (by_fours) return BlendByFours(state, target, args);
  VOXELPIPE_OK_OR_RETURN(FindAllCells(state, CellSink::kBlend, args.cover.fragments, &args.blend, by_id));
  const auto emit_waiting = by_id ? EmitWaiting<BlendWriter<kById>> : EmitWaiting<BlendWriter<-1>>;
  return emit_waiting(state, MakeRestArgs(state, 0, triangles, false), args);
}

// Rasterizes all triangles: small ones become records, spans of the others are listed up to the list's capacity. Counts
// are in state.counters, including the number of ranked voxels if `ranked`.
absl::Status FindAndList(RunState& state, bool ranked) {
  const uint64_t triangles = state.mesh.host_view.triangle_count;
  VOXELPIPE_OK_OR_RETURN(FindAllCells(state, CellSink::kRecordsAndBits, FragmentSlots(state)));
  const uint64_t guess = std::min(MostSpans(state), SpanRoom(triangles));
  if (state.lists.spans.size() < guess) VOXELPIPE_OK_OR_RETURN(state.lists.spans.Resize(guess, state.stream));
  VOXELPIPE_OK_OR_RETURN(ListSpans(state, 0, triangles, false));
  return ranked ? RankCovered(state) : absl::OkStatus();
}

// Number of entries of the list, given the count in state.counters[kSpans].
uint64_t CountListed(RunState& state, uint64_t counted) {
  return ListOf(state).own + counted;
}
absl::StatusOr<uint64_t> ReadListedSpans(RunState& state) {
  const auto counters = ReadCounters(state);
  if (!counters.ok()) return counters.status();
  return CountListed(state, (*counters)[kSpans]);
}

// Calls take(spans) for one or more lists that together hold the spans of triangles [begin, end), each within the span
// encoding's triangle limit. `counted`: the length of the current list, which is complete if it fits.
template <typename Take>
absl::Status ForEachList(RunState& state, uint64_t begin, uint64_t end, uint64_t counted, const Take& take) {
  const bool numbered = end - begin <= GetSpanLimits().triangles;
  while (numbered && counted > state.lists.spans.size() && (counted <= MostSpans(state) || end - begin == 1)) {
    state.lists.spans.Free();
    VOXELPIPE_OK_OR_RETURN(state.lists.spans.Resize(counted + counted / 16 + 1024, state.stream));
    VOXELPIPE_OK_OR_RETURN(ListSpans(state, begin, end, true));
    const absl::StatusOr<uint64_t> again = ReadListedSpans(state);
    if (!again.ok()) return again.status();
    counted = *again;
  }
  if (numbered && counted <= state.lists.spans.size()) return take(ListedSpans{counted, uint32_t(begin)});
  const uint64_t middle = begin + (end - begin) / 2;
  for (const auto& [from, to] : {std::pair(begin, middle), std::pair(middle, end)}) {
    VOXELPIPE_OK_OR_RETURN(ListSpans(state, from, to, true));
    const absl::StatusOr<uint64_t> here = ReadListedSpans(state);
    if (!here.ok()) return here.status();
    VOXELPIPE_OK_OR_RETURN(ForEachList(state, from, to, *here, take));
  }
  return absl::OkStatus();
}

// True if a target blends values per triangle instead of shading fragments.
bool ByTriangles(const RunState& state, int index) {
  const ValueSource source = state.plan.targets[size_t(index)].source;
  return source == ValueSource::kTriangles || source == ValueSource::kOwners;
}

// Where parts are filled and no target's accumulators hold them: records of all triangles, to the owners.
absl::Status TakeCellsOfOwners(RunState& state) {
  BlendCellsArgs args = RecordsOf(state);
  args.accumulate = OwnersOf(state);
  const auto kernel = BlendCellsTo<BlendTo::kAccumulators>(true, 1);
  kernel<<<BlendBlocks(state, args.triangles), kBlendThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("BlendCells");
  return absl::OkStatus();
}

// Blends records and then listed spans of all triangles into all targets.
absl::Status TakeAll(RunState& state) {
  const bool owners_apart = state.parts.filled && TargetOfOwners(state) < 0;
  if (owners_apart) VOXELPIPE_OK_OR_RETURN(TakeCellsOfOwners(state));
  for (int i = 0; i < state.targets.count; ++i) {
    if (ByTriangles(state, i)) VOXELPIPE_OK_OR_RETURN(TakeCells(state, i));
  }
  VOXELPIPE_OK_OR_RETURN(ShadeRecords(state));
  return ForEachList(state, 0, state.mesh.host_view.triangle_count, state.lists.span_count,
                     [&](const ListedSpans& listed) {
                       for (int i = 0; i < state.targets.count; ++i) {
                         if (ByTriangles(state, i)) VOXELPIPE_OK_OR_RETURN(TakeSpans(state, i, listed));
                       }
                       if (owners_apart && listed.count > 0) {
                         VOXELPIPE_OK_OR_RETURN(AccumulateSpans(state, OwnersOf(state), true, 1, listed));
                       }
                       return ShadeSpans(state, listed);
                     });
}

// If all targets may discard fragments, the touched voxels are not the coverage.
absl::Status BeginTouched(RunState& state) {
  if (state.targets.any_always_present) return absl::OkStatus();
  VOXELPIPE_OK_OR_RETURN(state.lists.touched_bits.Resize(state.slab_words(), state.stream));
  return state.lists.touched_bits.Fill(0, state.stream);
}

// Blends all triangles into accumulators or dense targets. Synchronizes.
absl::Status BlendByRecords(RunState& state, bool ranked) {
  VOXELPIPE_OK_OR_RETURN(BeginTouched(state));
  VOXELPIPE_OK_OR_RETURN(FindAndList(state, ranked));
  const auto counters = ReadCounters(state);
  if (!counters.ok()) return counters.status();
  state.lists.span_count = CountListed(state, (*counters)[kSpans]);
  state.lists.ranked_voxels = ranked ? (*counters)[kRanks] : 0;
  for (int i = 0; i < state.targets.count; ++i) {
    const PathPlan::Target& target = state.plan.targets[size_t(i)];
    if (target.source == ValueSource::kCoverage || target.in_place) continue;
    VOXELPIPE_OK_OR_RETURN(BeginAccumulators(state, i, state.lists.ranked_voxels));
  }
  if (state.parts.filled && TargetOfOwners(state) < 0) {
    VOXELPIPE_OK_OR_RETURN(BeginOwners(state, state.lists.ranked_voxels));
  }
  return TakeAll(state);
}

}  // namespace

absl::Status BlendDirectly(RunState& state) {
  const bool sparse = IsSparse(state);
  state.lists.span_count = 0;
  if (state.mesh.host_view.triangle_count == 0) return ClearFragmentSlots(state);
  bool ranked = state.parts.filled;  // for their owners
  int last = 0;                      // the last target with values
  for (int i = 0; i < state.targets.count; ++i) {
    const PathPlan::Target& target = state.plan.targets[size_t(i)];
    if (target.source == ValueSource::kCoverage) continue;
    if (ByTriangles(state, i)) VOXELPIPE_OK_OR_RETURN(MakeValues(state, i));
    ranked = ranked || !target.in_place;
    last = i;
  }
  if (state.plan.path == Path::kBricks) {
    VOXELPIPE_OK_OR_RETURN(BlendIntoPool(state, PlaceOf(state, last), state.span_targets[size_t(last)].by_id));
    if (state.plan.path == Path::kBricks) return sparse ? absl::OkStatus() : EmitPool(state);
    VOXELPIPE_OK_OR_RETURN(state.coverage.Resize(state.slab_words(), state.stream));
    VOXELPIPE_OK_OR_RETURN(state.coverage.Fill(0, state.stream));
  }
  if (state.plan.path == Path::kInPlace || state.plan.path == Path::kFloat4) {
    VOXELPIPE_OK_OR_RETURN(BlendWhatIsFound(state, last));
    return StoreDense(state, last);
  }
  VOXELPIPE_OK_OR_RETURN(BlendByRecords(state, ranked));
  VOXELPIPE_OK_OR_RETURN(KeepOwners(state));
  for (int i = 0; i < state.targets.count; ++i) {
    if (state.plan.targets[size_t(i)].source == ValueSource::kCoverage) continue;
    const bool later = sparse && state.targets.at[i].format != VoxelFormat::kBit;  // stored after its voxels are listed
    if (!later) VOXELPIPE_OK_OR_RETURN(StoreDense(state, i));
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
