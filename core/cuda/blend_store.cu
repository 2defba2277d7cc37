// Ranks, accumulators, and the kernels that store what was blended.
#include "cuda/blend_store.h"

#include "cuda/cells.h"
#include "cuda/device_abilities.h"
#include "cuda/fill_rows.cuh"
#include "cuda/scattered.h"
#include "cuda/span_store.cuh"
#include "cuda/sum_rows.cuh"

namespace voxelpipe::cuda {
namespace {

Ranks RanksOf(RunState& state) {
  Ranks ranks;
  ranks.bits = state.coverage.data();
  ranks.first = state.word_ranks.data();
  if (state.request.request.result != ResultKind::kSparse) return ranks;
  ranks.rows = state.row_ranks.data();
  ranks.first_brick = state.first_brick.data();
  ranks.by_words_per_row = MakeDivisor(uint32_t(state.view.words_per_row));
  ranks.by_ny = MakeDivisor(uint32_t(state.view.dims[1]));
  ranks.tiles_x = uint32_t(state.view.tiles.dims[0]);
  ranks.tiles_y = uint32_t(state.view.tiles.dims[1]);
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

// Whether a dense target's rows are whole units of 16 bytes that hold whole voxels, 32 in a word of coverage: then its sums can be
// stored by rows (sum_rows.cuh).
bool HasWholeRows(const RunState& state, const CudaTarget& target) {
  const bool wide = target.format == VoxelFormat::kU32 || target.format == VoxelFormat::kF32;
  const bool whole = target.components == 1 || (!state.targets.planar && target.components != 3);
  return wide && whole && state.view.dims[0] % 32 == 0;
}

absl::Status StoreKeys(RunState& state, const CudaTarget& target, SpanTarget& memory) {
  const bool is_float = target.format == VoxelFormat::kF32;
  const bool may_be_negative = is_float && !memory.by_id;
  if (target.blend != Blend::kMin && (target.blend != Blend::kMax || !may_be_negative)) return absl::OkStatus();
  KeyArgs keys;
  keys.coverage = state.coverage.data();
  keys.negative = is_float ? NegativeOf(state, memory) : nullptr;
  keys.out = reinterpret_cast<uint32_t*>(target.dense);
  keys.words = state.slab_words();
  keys.voxels = state.slab_voxels();
  keys.nx = state.view.dims[0];
  keys.words_per_row = state.view.words_per_row;
  keys.components = target.components;
  keys.planar = state.targets.planar;
  keys.complement = target.blend == Blend::kMin;
  keys.is_float = is_float;
  // As many blocks as there is work: some of them have much more than others.
  const unsigned blocks = BlocksFor(keys.words, kBlendThreads / 32 * kWordsOfWarp);
  LaunchEarly(BeginsEarly(state.device), state.stream, blocks, kBlendThreads, KeysToValues, keys);
  VOXELPIPE_LAUNCHED_OR_RETURN("KeysToValues");
  return absl::OkStatus();
}

StoreArgs MakeStoreArgs(RunState& state, const CudaTarget& target, SpanTarget& memory, uint8_t* out, uint64_t voxels) {
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
  const bool sparse = args.ranks.rows != nullptr;
  args.places = sparse ? state.listed_places.data() : nullptr;
  args.all = sparse && state.inside.empty();
  return args;
}

absl::Status Store(RunState& state, const CudaTarget& target, SpanTarget& memory, uint8_t* out, uint64_t voxels) {
  const StoreArgs args = MakeStoreArgs(state, target, memory, out, voxels);
  StoreAccumulated<<<BlendBlocks(state, args.words), kBlendThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("StoreAccumulated");
  return absl::OkStatus();
}

absl::Status StoreByRows(RunState& state, int index, bool covers) {
  const CudaTarget& target = state.targets.at[index];
  SpanTarget& memory = state.span_targets[size_t(index)];
  SumRowArgs args;
  args.store = MakeStoreArgs(state, target, memory, target.dense, state.slab_voxels());
  args.brings = SumsOf(state, index);
  args.by_id = memory.by_id;
  args.clear_stored = target.clear_stored;
  args.walk = MakeRestArgs(state, 0, 0, false).walk;
  if (covers) {
    args.coverage = state.coverage.data();
    args.fragments = FragmentSlots(state);
  }
  constexpr int kById = int(FragmentShaderId::kTriangleId);
  const auto kernel = target.components == 1   ? StoreSumRows<1, kById>
                      : target.components == 2 ? StoreSumRows<2, kById>
                                               : StoreSumRows<4, kById>;
  const auto blocks = unsigned(state.device.multiprocessors) * kRowBlocks;
  kernel<<<blocks, kRowThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("StoreSumRows");
  return absl::OkStatus();
}

}  // namespace

bool IsInPlace(const CudaTarget& target) {
  if (target.clear_stored != 0) return false;
  const bool u32 = target.format == VoxelFormat::kU32, f32 = target.format == VoxelFormat::kF32;
  if (target.blend == Blend::kMin || target.blend == Blend::kMax) return u32 || f32;
  return u32 && (target.blend == Blend::kOr || target.blend == Blend::kCount);
}

bool IsFine(const RunState& state) {
  constexpr uint64_t kLeastBlocks = 16;
  const uint64_t least = AssumedCache() > 0 ? 1 : uint64_t(state.device.multiprocessors) * kLeastBlocks;
  return state.mesh.host_view.triangle_count >= least * kBlendThreads;
}

absl::Status RankCovered(RunState& state) {
  const uint64_t words = state.slab_words();
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kRanks}));
  VOXELPIPE_OK_OR_RETURN(state.word_ranks.Resize(words, state.stream));
  RankWords<<<BlocksFor(words, kBlendThreads * kRankedOfThread, UINT32_MAX), kBlendThreads, 0, state.stream>>>(
      state.coverage.data(), words, state.word_ranks.data(), state.counters.data() + kRanks);
  VOXELPIPE_LAUNCHED_OR_RETURN("RankWords");
  return absl::OkStatus();
}

absl::Status BeginAccumulators(RunState& state, int index, uint64_t voxels) {
  const CudaTarget& target = state.targets.at[index];
  SpanTarget& memory = state.span_targets[size_t(index)];
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

AccumulateArgs SumsOf(RunState& state, int index) {
  SpanTarget& memory = state.span_targets[size_t(index)];
  AccumulateArgs args;
  args.values = memory.values.data();
  args.terms = memory.terms.data();
  args.shading = memory.shading;
  args.ranks = RanksOf(state);
  args.to = AccumulatorsOf(state.targets.at[index], memory);
  return args;
}

absl::Status StoreDense(RunState& state, int index, bool covers) {
  const CudaTarget& target = state.targets.at[index];
  SpanTarget& memory = state.span_targets[size_t(index)];
  if (memory.by_rows) return StoreByRows(state, index, covers);
  if (memory.in_place) return StoreKeys(state, target, memory);
  return Store(state, target, memory, target.dense, state.slab_voxels());
}

absl::Status FillDense(RunState& state, int index, const InPlaceArgs& place, bool covers) {
  FillRowArgs args;
  args.place = place;
  args.by_id = state.span_targets[size_t(index)].by_id;
  args.walk = MakeRestArgs(state, 0, 0, false).walk;
  if (covers) {
    args.coverage = state.coverage.data();
    args.fragments = FragmentSlots(state);
  }
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kNextRows}));
  args.taken = reinterpret_cast<uint32_t*>(state.counters.data() + kNextRows);
  const auto blocks = unsigned(state.device.multiprocessors) * kFillBlocks;
  FillRows<int(FragmentShaderId::kTriangleId)><<<blocks, kFillThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("FillRows");
  return absl::OkStatus();
}

absl::Status StoreListed(RunState& state, int index, uint8_t* out, uint64_t voxels) {
  return Store(state, state.targets.at[index], state.span_targets[size_t(index)], out, voxels);
}

bool FillsByRows(const RunState& state) {
  const VoxelizeRequest& request = state.request.request;
  if (!state.direct || request.result != ResultKind::kDense || state.mesh.host_view.triangle_count == 0) return false;
  if (state.scattered_mesh.largest == nullptr) return false;
  if (!ExceedsCache(state.device, state.slab_voxels() * sizeof(uint32_t))) return false;
  for (size_t i = 0; i < request.targets.size(); ++i) {
    const CudaTarget target = DescribeTarget(request.targets[i], state.request.fragment_shaders[i]);
    if (target.is_occupancy) continue;
    const bool sought = target.blend == Blend::kMax || target.blend == Blend::kMin;
    if (!sought || target.components != 1 || !IsInPlace(target) || !HasWholeRows(state, target)) return false;
  }
  return true;
}

bool StoresByRows(RunState& state, const CudaTarget& target) {
  if (!state.direct || state.request.request.result != ResultKind::kDense || KeptBy(target) != Kept::kSum) return false;
  // Of triangles that are not scattered it takes longer than to clear the target and to store what is covered.
  return state.mesh.host_view.triangle_count > 0 && HasWholeRows(state, target) && NeedsOrder(state);
}

}  // namespace voxelpipe::cuda
