// Launches the kernels that store blended values.
#include "cuda/scatter/store_values.h"

#include "cuda/coverage/coverage_pass.h"
#include "cuda/device/device_caps.h"
#include "cuda/scatter/store_accumulators.cuh"
#include "cuda/shading/shade_list.h"

namespace voxelpipe::cuda {
namespace {

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
  // One block per unit of work, because the load is uneven.
  const unsigned blocks = BlocksFor(keys.words, kBlendThreads / 32 * kWordsOfWarp);
  LaunchEarly(BeginsEarly(state.device), state.stream, blocks, kBlendThreads, KeysToValues, keys);
  VOXELPIPE_LAUNCHED_OR_RETURN("KeysToValues");
  return absl::OkStatus();
}

StoreArgs MakeStoreArgs(RunState& state, int index, uint8_t* out, uint64_t voxels) {
  const CudaTarget& target = state.targets.at[index];
  StoreArgs args;
  args.ranks = RanksOf(state);
  args.from = AccumulatorsOf(state, index);
  args.format = target.format;
  args.is_float = IsFloat(target.format);
  args.planar = state.targets.planar;
  args.quantum = target.quantum;
  args.words = state.slab_words();
  args.voxels = voxels;
  args.nx = uint32_t(state.view.dims[0]);
  args.words_per_row = uint32_t(state.view.words_per_row);
  args.out = out;
  args.present = target.own_presence ? target.presence : state.coverage.data();
  args.bits = target.bits;
  return args;
}

// Shades the owner of each of a target's voxels.
absl::Status StoreOwners(RunState& state, int index, const StoreArgs& from, bool listed) {
  OwnerList& owners = state.owners;
  const uint64_t most = listed ? from.voxels : state.lists.ranked_voxels;
  if (most == 0) return absl::OkStatus();
  for (auto* array : {&owners.keys, &owners.triangles, &owners.to}) {
    VOXELPIPE_OK_OR_RETURN(array->Resize(most, state.stream));
  }
  VOXELPIPE_OK_OR_RETURN(
      owners.triangles.Fill(0xff, state.stream));  // kNoTriangleListed: the target has no fragment there
  OwnerListArgs args;
  args.from = from;
  if (state.targets.at[index].blend == Blend::kFirst && !state.parts.ids_in_order) {
    args.by_id = state.parts.by_id.data();
    args.id_runs = uint32_t(state.parts.by_id.size());
  }
  args.keys = owners.keys.data();
  args.triangles = owners.triangles.data();
  args.to = owners.to.data();
  ListOwners<<<BlendBlocks(state, from.words), kBlendThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ListOwners");
  FragmentList list;
  list.keys = args.keys;
  list.triangles = args.triangles;
  list.count = most;
  list.to = args.to;
  list.plane = from.voxels;
  uint8_t* const out = from.bits != nullptr ? reinterpret_cast<uint8_t*>(from.bits) : from.out;
  return ShadeList(state, index, list, out);
}

absl::Status Store(RunState& state, int index, const StoreArgs& args) {
  const CudaTarget& target = state.targets.at[index];
  if (HasOwner(target)) {
    return StoreOwners(state, index, args, args.listed != nullptr);
  }
  const uint64_t work = args.listed != nullptr ? args.voxels : args.words;
  StoreAccumulated<<<BlendBlocks(state, work), kBlendThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("StoreAccumulated");
  return absl::OkStatus();
}

}  // namespace

AccumulateArgs SumsOf(RunState& state, int index) {
  SpanTarget& memory = state.span_targets[size_t(index)];
  AccumulateArgs args;
  args.values = memory.values.data();
  args.terms = memory.terms.data();
  args.shading = memory.shading;
  args.ranks = RanksOf(state);
  args.to = AccumulatorsOf(state, index);
  return args;
}

absl::Status StoreDense(RunState& state, int index) {
  const CudaTarget& target = state.targets.at[index];
  SpanTarget& memory = state.span_targets[size_t(index)];
  if (state.plan.targets[size_t(index)].in_place) return StoreKeys(state, target, memory);
  return Store(state, index, MakeStoreArgs(state, index, target.dense, state.slab_voxels()));
}

absl::Status StoreListed(RunState& state) {
  if (state.mesh.host_view.triangle_count == 0) return absl::OkStatus();
  for (int i = 0; i < state.targets.count; ++i) {
    const CudaTarget& target = state.targets.at[i];
    if (target.format == VoxelFormat::kBit) continue;  // stored before the bricks were made
    StoreArgs args = MakeStoreArgs(state, i, state.result.targets[size_t(i)].data(), state.result.listed_voxels);
    args.listed = state.sparse.listed_bits.data();
    VOXELPIPE_OK_OR_RETURN(Store(state, i, args));
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
