// Launches the kernels for items of a batch whose targets have values, and lays out their accumulators.
#include "cuda/batch/batch_values.cuh"

#include <algorithm>

#include "absl/strings/str_cat.h"
#include "cuda/batch/batch_values.h"
#include "cuda/device/device_layout.h"
#include "cuda/device/launch.cuh"
#include "cuda/traversal/triangle_walk.h"

namespace voxelpipe::cuda {

void BatchValues::Add(uint32_t number, const TargetViews& targets, BatchItemView& item) {
  if (items_++ == 0) first_item_ = number;
  BatchShading& shading = item.shading;
  shading.first_target = uint32_t(targets_.size());
  shading.planar = targets.planar;
  shading.drops = !targets.any_always_present;
  for (int t = 0; t < targets.count; ++t) {
    const CudaTarget& target = targets.at[t];
    if (target.is_occupancy) continue;  // the coverage is the value
    const ShadedTarget& shaded = targets_.emplace_back(ShadedTargetOf(target, ShapeOf(target)));
    item_of_.push_back(number);
    if (NeedsNoShading(shaded)) continue;
    shading.shades = true;
    shading.traits |= TraitsOf(target.shader);
  }
  shading.target_count = int(targets_.size() - shading.first_target);
}

absl::Status BatchValues::Allocate(BatchState& state, const std::vector<uint32_t>& touched) {
  // Accumulators that start at 0, followed by those that start with all bits set.
  BlockLayout layout;
  std::vector<uint64_t> cells(targets_.size()), sums(targets_.size()), counts(targets_.size());
  const auto voxels_of = [&](size_t t) { return touched[item_of_[t] - first_item_]; };
  for (size_t t = 0; t < targets_.size(); ++t) {
    const Accumulators& to = targets_[t].to;
    const uint64_t voxels = voxels_of(t), components = uint64_t(to.components);
    const bool summed = IsSum(to.kept), counted = to.kept == Kept::kCount || to.kept == Kept::kAverage;
    sums[t] = layout.Add<unsigned long long>(summed ? voxels * components : 0);
    counts[t] = layout.Add<uint32_t>(counted ? voxels : 0);
    const bool of_zeros = !summed && !counted && !BeginsWithOnes(to.kept);
    cells[t] = layout.Add<uint32_t>(of_zeros ? voxels * components : 0);
  }
  const uint64_t zeros = layout.bytes();
  for (size_t t = 0; t < targets_.size(); ++t) {
    const Accumulators& to = targets_[t].to;
    if (BeginsWithOnes(to.kept)) cells[t] = layout.Add<uint32_t>(voxels_of(t) * uint64_t(to.components));
  }
  VOXELPIPE_OK_OR_RETURN(accumulators_.Resize(layout.bytes(), state.stream));
  VOXELPIPE_CUDA_OR_RETURN(cudaMemsetAsync(accumulators_.data(), 0, zeros, state.stream));
  VOXELPIPE_CUDA_OR_RETURN(cudaMemsetAsync(accumulators_.data() + zeros, 0xff, layout.bytes() - zeros, state.stream));
  for (size_t t = 0; t < targets_.size(); ++t) {
    Accumulators& to = targets_[t].to;
    to.cells = cuda::At<uint32_t>(accumulators_, cells[t]);
    to.sums = cuda::At<unsigned long long>(accumulators_, sums[t]);
    to.counts = cuda::At<uint32_t>(accumulators_, counts[t]);
  }
  VOXELPIPE_OK_OR_RETURN(targets_there_.Upload(targets_, state.stream));
  return item_of_there_.Upload(item_of_, state.stream);
}

absl::Status BatchValues::Make(BatchState& state) {
  const BatchView& batch = state.view;
  BatchTriangles of;
  of.first = batch.row_triangles;
  of.count = batch.value_triangles;
  of.queue = kBatchValues;
  of.fragments = batch.value_counts;
  if (of.count == 0) return absl::OkStatus();
  const BatchWalkArgs walk = WalkOf(batch, of.first, of.count, of.queue);
  CountAndSetBits found{SetBatchBits<&BatchItemView::first_touched>(walk, batch.bits), {}};
  found.count.counts = of.fragments;
  VOXELPIPE_OK_OR_RETURN(WalkOn(state.device, state.stream, walk, found));
  DeviceArray<uint64_t> firsts;
  VOXELPIPE_OK_OR_RETURN(FindFirsts(state, of, firsts));
  VOXELPIPE_OK_OR_RETURN(touched_.Resize(items_, state.stream));
  RankItems<<<items_, kRankThreads, 0, state.stream>>>(batch, first_item_, of.first, firsts.data(), touched_.data());
  VOXELPIPE_LAUNCHED_OR_RETURN("RankItems");
  std::vector<uint32_t> touched(items_);
  uint64_t fragments = 0;
  VOXELPIPE_CUDA_OR_RETURN(
      cudaMemcpyAsync(touched.data(), touched_.data(), touched_.bytes(), cudaMemcpyDeviceToHost, state.stream));
  VOXELPIPE_CUDA_OR_RETURN(
      cudaMemcpyAsync(&fragments, firsts.data() + of.count, sizeof fragments, cudaMemcpyDeviceToHost, state.stream));
  VOXELPIPE_CUDA_OR_RETURN(cudaStreamSynchronize(state.stream));
  if (fragments >= UINT32_MAX) {
    return absl::ResourceExhaustedError(
        absl::StrCat("a batch has ", fragments, " fragments; a pass takes fewer than 2^32"));
  }
  if (fragments == 0) return absl::OkStatus();
  VOXELPIPE_OK_OR_RETURN(Allocate(state, touched));
  DeviceArray<uint32_t> keys, triangles;
  VOXELPIPE_OK_OR_RETURN(keys.Resize(fragments, state.stream));
  VOXELPIPE_OK_OR_RETURN(triangles.Resize(fragments, state.stream));
  VOXELPIPE_OK_OR_RETURN(EmitList(state, of, firsts.data(), keys.data(), triangles.data()));
  BlendBatchFragments<<<BlocksFor(fragments, kValueThreads), kValueThreads, 0, state.stream>>>(
      batch, targets_there_.data(), keys.data(), triangles.data(), fragments);
  VOXELPIPE_LAUNCHED_OR_RETURN("BlendBatchFragments");
  if (targets_.empty()) return absl::OkStatus();
  const dim3 blocks(std::min(uint32_t(targets_.size()), 1u << 16), 4);
  StoreBatchValues<<<blocks, kValueThreads, 0, state.stream>>>(batch, targets_there_.data(), item_of_there_.data(),
                                                               uint32_t(targets_.size()));
  VOXELPIPE_LAUNCHED_OR_RETURN("StoreBatchValues");
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
