// A-buffers of a batch, as in a_buffer.cu, with the fragments of all items in one list. One sort orders them by item
// and voxel.
#include "cuda/a_buffer/resolve.h"
#include "cuda/batch/batch_fragments.cuh"

#include <algorithm>
#include <bit>

#include "absl/strings/str_cat.h"
#include "cuda/batch/batch.h"
#include "cuda/device/launch.cuh"
#include "cuda/primitives/scan.h"
#include "cuda/traversal/triangle_walk.h"

namespace voxelpipe::cuda {
namespace {

SortedKeys KeysOf(BatchState& state) {
  SortedKeys keys;
  keys.keys = state.fragments.keys[state.fragments.current].data();
  keys.fragments = state.fragments.count;
  keys.first = state.chunks.data();
  return keys;
}

}  // namespace

absl::Status FindFirsts(BatchState& state, const BatchTriangles& of, DeviceArray<uint64_t>& firsts) {
  VOXELPIPE_OK_OR_RETURN(firsts.Resize(of.count + 1, state.stream));
  return ExclusiveScan(of.fragments, firsts.data(), of.count + 1, state.scratch, state.stream);
}

absl::Status EmitList(BatchState& state, const BatchTriangles& of, const uint64_t* firsts, uint32_t* keys,
                      uint32_t* triangles) {
  const BatchWalkArgs args = WalkOf(state.view, of.first, of.count, of.queue);
  EmitFragment emit;
  emit.items = args.items;
  emit.item_of = args.item_of;
  emit.first_triangle = of.first;
  emit.first = firsts;
  emit.emitted = of.fragments;
  emit.keys = keys;
  emit.values = triangles;
  VOXELPIPE_CUDA_OR_RETURN(cudaMemsetAsync(emit.emitted, 0, of.count * sizeof(uint32_t), state.stream));
  EmitRuns<<<unsigned((of.count + kRunThreads - 1) / kRunThreads), kRunThreads, 0, state.stream>>>(args, emit);
  VOXELPIPE_LAUNCHED_OR_RETURN("EmitRuns");
  return WalkOn(state.device, state.stream, args, emit, /*skip_runs=*/true);
}

absl::Status EmitBatch(BatchState& state) {
  const BatchView& batch = state.view;
  Fragments& fragments = state.fragments;
  BatchTriangles of;
  of.first = batch.row_triangles + batch.value_triangles;
  of.count = batch.triangle_count - of.first;
  of.queue = kBatchFragments;
  of.fragments = batch.fragment_counts;
  fragments.Clear();
  if (of.count == 0) return absl::OkStatus();
  CountFragments count;
  count.counts = of.fragments;
  VOXELPIPE_OK_OR_RETURN(WalkOn(state.device, state.stream, WalkOf(batch, of.first, of.count, of.queue), count));
  DeviceArray<uint64_t> firsts;
  VOXELPIPE_OK_OR_RETURN(FindFirsts(state, of, firsts));
  const absl::StatusOr<uint64_t> total = ReadElement(firsts.data() + of.count, state.stream);
  if (!total.ok()) return total.status();
  if (*total >= UINT32_MAX) {
    return absl::ResourceExhaustedError(
        absl::StrCat("a batch's A-buffers have ", *total, " fragments; a pass takes fewer than 2^32"));
  }
  fragments.count = *total;
  if (fragments.count == 0) return absl::OkStatus();
  VOXELPIPE_OK_OR_RETURN(fragments.MakeRoom(state.stream));
  return EmitList(state, of, firsts.data(), fragments.keys[0].data(), fragments.triangles[0].data());
}

absl::StatusOr<std::vector<uint64_t>> SortBatch(BatchState& state) {
  const BatchView& batch = state.view;
  Fragments& fragments = state.fragments;
  if (state.drops) {
    DropFragments<<<BlocksFor(fragments.count, 256), 256, 0, state.stream>>>(
        batch, fragments.keys[0].data(), fragments.triangles[0].data(), fragments.count);
    VOXELPIPE_LAUNCHED_OR_RETURN("DropFragments");
  }
  const uint64_t last_key = state.drops ? batch.voxel_count : batch.voxel_count - 1;
  const int bits = std::max(1, int(std::bit_width(last_key)));
  VOXELPIPE_OK_OR_RETURN(SortFragmentList(fragments, bits, state.scratch, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.chunks.Resize(KeysOf(state).chunks() + 1, state.stream));
  const SortedKeys keys = KeysOf(state);
  VOXELPIPE_OK_OR_RETURN(CountBuckets(keys, state.stream));
  std::vector<uint64_t> found(batch.item_count - state.first_bucketed + 2);
  DeviceArray<uint64_t> found_there;
  VOXELPIPE_OK_OR_RETURN(found_there.Resize(found.size(), state.stream));
  FindItems<<<BlocksFor(found.size(), 256, UINT32_MAX), 256, 0, state.stream>>>(
      batch, state.first_bucketed, keys.keys, keys.fragments, keys.first + keys.chunks(), found_there.data());
  VOXELPIPE_LAUNCHED_OR_RETURN("FindItems");
  VOXELPIPE_CUDA_OR_RETURN(
      cudaMemcpyAsync(found.data(), found_there.data(), found_there.bytes(), cudaMemcpyDeviceToHost, state.stream));
  VOXELPIPE_CUDA_OR_RETURN(cudaStreamSynchronize(state.stream));
  return found;
}

absl::Status ListBatch(BatchState& state, uint32_t* voxels, uint32_t* offsets) {
  BucketArgs<uint32_t> args;
  static_cast<SortedKeys&>(args) = KeysOf(state);
  args.offsets = offsets;
  args.voxels = voxels;
  return ListBuckets(args, state.stream);
}

absl::Status ShadeBatch(BatchState& state, BatchShadeArgs args) {
  if (args.threads == 0) return absl::OkStatus();
  args.keys = KeysOf(state).keys;
  args.triangles = state.fragments.triangles[state.fragments.current].data();
  ShadeBatchFragments<<<BlocksFor(args.threads, 256), 256, 0, state.stream>>>(state.view, args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ShadeBatchFragments");
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
