#include "cuda/apart_fragments.h"

#include <algorithm>

#include "cuda/apart_fragments.cuh"
#include "cuda/bit_args.h"
#include "cuda/device_abilities.h"
#include "cuda/launch.h"
#include "cuda/list_sizes.h"
#include "cuda/merge_fragments.cuh"
#include "cuda/run_state.h"

namespace voxelpipe::cuda {
namespace {

constexpr uint64_t kSetupBytes = kMostApart * sizeof(SharedSetup);
// Blocks of ListApart on a multiprocessor, where eleven would find room: the kernels of the run's stream need some too. Four take the place of one block
// of a sort's pass, of which two find room.
constexpr unsigned kApartBeside = 4;

uint32_t GroupsOf(const RunState& state) {
  const auto along_y = (uint32_t(state.slab_dims[1]) + kApartGroup - 1) / kApartGroup;
  return along_y * uint32_t(state.slab_dims[2]);
}

// Room for as many as there are most often; where the cache is taken for a small one, for few, so that they are listed once more.
uint64_t GuessApart(const RunState& state) {
  if (AssumedCache() > 0) return 1 << 10;
  constexpr uint64_t kMost = 1 << 24, kPartOfMemory = 64;
  const uint64_t memory = std::min(state.device.memory_bytes, MemoryLimit());
  const uint64_t expected = FragmentRoom(MostOfSlab(state.expected, state.grid, state.slab.depth()).fragments);
  return std::min({kMost, state.slab_voxels(), expected, memory / kPartOfMemory / (2 * sizeof(uint32_t))});
}

}  // namespace

bool ApartFragments::Pays(const RunState& state) {
  return state.scattered_mesh.largest != nullptr && state.slab_rows() > kRowsOfWarp &&
         state.view.dims[0] <= kMostApartRow;
}

absl::StatusOr<ApartFragments> ApartFragments::Make(const RunState& state) {
  absl::StatusOr<DeviceUse> use = DeviceUse::Begin(state.device.ordinal, Turn::kBehind);
  if (!use.ok()) return use.status();
  ApartFragments made(*std::move(use));
  absl::StatusOr<PinnedBuffer> listed = PinnedBuffer::Take(sizeof(uint64_t));
  if (!listed.ok()) return listed.status();
  made.listed_ = *std::move(listed);
  VOXELPIPE_OK_OR_RETURN(made.MakeRoom(state, GuessApart(state)));
  VOXELPIPE_OK_OR_RETURN(
      made.room_.Resize(kSetupBytes + (GroupsOf(state) + uint64_t{2}) * sizeof(uint64_t), state.stream));
  VOXELPIPE_OK_OR_RETURN(made.SetUp(state));
  return made;
}

absl::Status ApartFragments::MakeRoom(const RunState& state, uint64_t fragments) {
  VOXELPIPE_OK_OR_RETURN(keys_.Resize(fragments, state.stream));
  return triangles_.Resize(fragments, state.stream);
}

ApartArgs ApartFragments::Args(const RunState& state) {
  ApartArgs args;
  args.grid = state.view;
  args.largest = state.scattered_mesh.largest;
  args.setups = reinterpret_cast<SharedSetup*>(room_.data());
  args.keys = keys_.data();
  args.triangles = triangles_.data();
  args.room = keys_.size();
  args.groups = GroupsOf(state);
  args.before = reinterpret_cast<uint64_t*>(room_.data() + kSetupBytes);
  args.total = args.before + args.groups;
  args.taken = reinterpret_cast<uint32_t*>(args.total + 1);
  return args;
}

absl::Status ApartFragments::SetUp(const RunState& state) {
  VOXELPIPE_OK_OR_RETURN(use_.After(state.stream));
  BitArgs walk;
  walk.grid = state.view;
  walk.coverage = state.request.request.coverage;
  SetTriangles(state, walk);
  walk.largest = state.scattered_mesh.largest;
  SetUpListed<<<(kMostApart + kMostInParts - 1) / kMostInParts, 32, 0, use_.stream()>>>(walk, Args(state));
  VOXELPIPE_LAUNCHED_OR_RETURN("SetUpListed");
  return absl::OkStatus();
}

absl::Status ApartFragments::Start(const RunState& state) {
  const cudaStream_t stream = use_.stream();
  VOXELPIPE_OK_OR_RETURN(use_.After(state.stream));
  const ApartArgs args = Args(state);
  const unsigned most = unsigned(state.device.multiprocessors) * kApartBeside;
  ListApart<<<std::min(args.groups, most), kApartThreads, 0, stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ListApart");
  VOXELPIPE_CUDA_OR_RETURN(
      cudaMemcpyAsync(listed_.data(), args.total, sizeof(uint64_t), cudaMemcpyDeviceToHost, stream));
  return absl::OkStatus();
}

absl::Status ApartFragments::Wait(const RunState& state) {
  VOXELPIPE_CUDA_OR_RETURN(cudaStreamSynchronize(use_.stream()));
  count_ = *reinterpret_cast<const uint64_t*>(listed_.data());
  if (count_ <= keys_.size()) return absl::OkStatus();
  VOXELPIPE_OK_OR_RETURN(MakeRoom(state, count_));
  VOXELPIPE_OK_OR_RETURN(SetUp(state));  // clears what ListApart wants cleared
  VOXELPIPE_OK_OR_RETURN(Start(state));
  VOXELPIPE_CUDA_OR_RETURN(cudaStreamSynchronize(use_.stream()));
  return absl::OkStatus();
}

namespace {

// What both kernels that merge get. The other copy becomes the current one, with room for keys if they are kept. state.bucket_chunks has what blocks say
// and, behind that, the splits: who lists buckets of merged fragments afterwards finds as many elements as it wants, and 0 in them.
absl::StatusOr<MergeArgs> BeginMerge(RunState& state, bool keeps_keys) {
  static_assert(kMergedOfBlock <= kKeysOfChunk);
  Fragments& fragments = state.fragments;
  const int from = fragments.current, to = 1 - from;
  MergeArgs args;
  args.from[0] = {fragments.KeysAs<uint32_t>(from), fragments.triangles[from].data(), fragments.count};
  args.from[1] = state.apart->sorted();
  fragments.count += args.from[1].count;
  VOXELPIPE_OK_OR_RETURN(fragments.MakeRoom(to, fragments.count, keeps_keys ? sizeof(uint32_t) : 0, state.stream));
  const uint64_t blocks = MergeBlocksOf(args);
  VOXELPIPE_OK_OR_RETURN(state.bucket_chunks.Resize(2 * blocks + 1, state.stream));
  args.keys = fragments.KeysAs<uint32_t>(to);
  args.triangles = fragments.triangles[to].data();
  args.before = state.bucket_chunks.data();
  args.splits = args.before + blocks;
  fragments.current = to;
  const auto of_splits = unsigned((blocks + 1) * kSplitLanes / kMergeThreads + 1);
  LaunchEarly(BeginsEarly(state.device), state.stream, of_splits, kMergeThreads, FindSplits, args);
  VOXELPIPE_LAUNCHED_OR_RETURN("FindSplits");
  return args;
}

}  // namespace

absl::Status MergeApart(RunState& state) {
  const absl::StatusOr<MergeArgs> args = BeginMerge(state, true);
  if (!args.ok()) return args.status();
  LaunchEarly(BeginsEarly(state.device), state.stream, unsigned(MergeBlocksOf(*args)), kMergeThreads, MergeLists,
              *args);
  VOXELPIPE_LAUNCHED_OR_RETURN("MergeLists");
  state.apart.reset();
  if (state.targets.any_always_present) return absl::OkStatus();
  Fragments& fragments = state.fragments;  // who drops some of them wants as much room in the other copy
  return fragments.MakeRoom(1 - fragments.current, fragments.count, sizeof(uint32_t), state.stream);
}

absl::Status MergeApartIntoBuckets(RunState& state, BucketArgs<uint64_t> buckets) {
  const absl::StatusOr<MergeArgs> args = BeginMerge(state, false);
  if (!args.ok()) return args.status();
  buckets.fragments = state.fragments.count;
  buckets.first = args->before;
  LaunchEarly(BeginsEarly(state.device), state.stream, unsigned(MergeBlocksOf(*args)), kMergeThreads, MergeIntoBuckets,
              *args, buckets);
  VOXELPIPE_LAUNCHED_OR_RETURN("MergeIntoBuckets");
  state.apart.reset();
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
