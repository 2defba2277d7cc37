// The steps of a pass for its A-buffers: emit, sort, list and shade fragments, copy back, extract results.
#include "cuda/batch/batch_buckets.h"

#include <algorithm>
#include <cstring>

#include "cuda/device/device_layout.h"
#include "cuda/run/run_state.h"
#include "pipeline/plan/plan.h"

namespace voxelpipe::cuda {
namespace {

template <typename T>
absl::Status Allocate(uint64_t count, HostBuffer& to) {
  absl::StatusOr<HostBuffer> allocated = HostBuffer::Allocate(count * sizeof(T));
  if (!allocated.ok()) return allocated.status();
  to = *std::move(allocated);
  return absl::OkStatus();
}

// Converts numbers to 64 bits and subtracts `base`.
absl::Status Widen(const uint32_t* from, uint64_t count, uint64_t base, HostBuffer& to) {
  VOXELPIPE_OK_OR_RETURN(Allocate<uint64_t>(count, to));
  std::transform(from, from + count, reinterpret_cast<uint64_t*>(to.data()), [&](uint32_t n) { return n - base; });
  return absl::OkStatus();
}

absl::Status Copy(const uint8_t* from, uint64_t bytes, HostBuffer& to) {
  VOXELPIPE_OK_OR_RETURN(Allocate<uint8_t>(bytes, to));
  if (bytes > 0) std::memcpy(to.data(), from, bytes);
  return absl::OkStatus();
}

absl::Status Ones(uint64_t bits, HostBuffer& to) {
  VOXELPIPE_OK_OR_RETURN(Allocate<uint8_t>((bits + 7) / 8, to));
  std::fill_n(to.data(), to.size(), uint8_t{0xff});
  if (bits % 8 != 0) to.data()[bits / 8] = uint8_t((1u << (bits % 8)) - 1);
  return absl::OkStatus();
}

}  // namespace

void BatchBuckets::Add(const BatchMember& member, uint32_t number, BatchItemView& item, BatchState& state) {
  if (items_.empty()) state.first_bucketed = number;
  Bucketed& of = items_.emplace_back();
  of.request = &member.request();
  of.item = number;
  of.first_target = uint32_t(targets_.size());
  of.shades = ShadesFragments(*member.bound);
  of.first_voxel = item.first_voxel = state.view.voxel_count;
  of.voxel_end = state.view.voxel_count += member.plan.grid.voxels();
  if (!of.shades) return;
  BatchShading& shading = item.shading;
  shading.first_target = of.first_target;
  shading.target_count = int(of.request->targets.size());
  shading.planar = of.request->layout == Layout::kPlanar;
  shading.drops = true;
  for (size_t t = 0; t < of.request->targets.size(); ++t) {
    targets_.push_back(DescribeTarget(of.request->targets[t], member.bound->fragment_shaders[t]));
    shading.traits |= TraitsOf(targets_.back().shader);
    shading.drops = shading.drops && targets_.back().own_presence;
  }
  state.drops = state.drops || shading.drops;
}

absl::Status BatchBuckets::Make(BatchState& state) {
  if (items_.empty()) return absl::OkStatus();
  VOXELPIPE_OK_OR_RETURN(EmitBatch(state));
  if (state.fragments.count == 0) return absl::OkStatus();
  const absl::StatusOr<std::vector<uint64_t>> found = SortBatch(state);
  if (!found.ok()) return found.status();
  voxels_ = found->back();
  BlockLayout layout;
  layout.Add<uint32_t>(voxels_);
  offsets_at_ = layout.Add<uint32_t>(voxels_ + 1);
  values_at_.resize(targets_.size());
  for (size_t i = 0; i < items_.size(); ++i) {
    Bucketed& of = items_[i];
    of.first_fragment = (*found)[i];
    of.fragments = (*found)[i + 1] - of.first_fragment;
    for (size_t t = 0; of.shades && t < of.request->targets.size(); ++t) {
      values_at_[of.first_target + t] = layout.Add<uint8_t>(TargetBytes(of.request->targets[t], of.fragments));
    }
  }
  VOXELPIPE_OK_OR_RETURN(results_.Resize(layout.bytes(), state.stream));
  VOXELPIPE_OK_OR_RETURN(results_.Fill(0, state.stream));  // padding between arrays is copied too
  triangles_at_ = layout.Add<uint32_t>(state.fragments.count);
  result_bytes_ = layout.bytes();
  VOXELPIPE_OK_OR_RETURN(ListBatch(state, At<uint32_t>(results_, 0), At<uint32_t>(results_, offsets_at_)));
  return Shade(state);
}

absl::Status BatchBuckets::Shade(BatchState& state) {
  BatchShadeArgs args;
  for (const Bucketed& of : items_) {
    if (!of.shades || of.fragments == 0) continue;
    BatchFragmentRange& range = ranges_.emplace_back();
    range.item = of.item;
    range.first = of.first_fragment;
    range.count = of.fragments;
    range.first_thread = args.threads;
    args.threads += (of.fragments + 31) / 32 * 32;
  }
  if (ranges_.empty()) return absl::OkStatus();
  std::vector<uint8_t*> values(targets_.size());
  for (size_t t = 0; t < values.size(); ++t) values[t] = At<uint8_t>(results_, values_at_[t]);
  VOXELPIPE_OK_OR_RETURN(ranges_there_.Upload(ranges_, state.stream));
  VOXELPIPE_OK_OR_RETURN(values_there_.Upload(values, state.stream));
  args.ranges = ranges_there_.data();
  args.range_count = uint32_t(ranges_.size());
  args.out = values_there_.data();
  return ShadeBatch(state, args);
}

absl::Status BatchBuckets::CopyBack(BatchState& state, uint8_t* to) const {
  if (result_bytes_ == 0) return absl::OkStatus();
  VOXELPIPE_CUDA_OR_RETURN(
      cudaMemcpyAsync(to, results_.data(), results_.bytes(), cudaMemcpyDeviceToHost, state.stream));
  const DeviceArray<uint32_t>& triangles = state.fragments.triangles[state.fragments.current];
  VOXELPIPE_CUDA_OR_RETURN(
      cudaMemcpyAsync(to + triangles_at_, triangles.data(), triangles.bytes(), cudaMemcpyDeviceToHost, state.stream));
  return absl::OkStatus();
}

absl::Status BatchBuckets::Cut(size_t number, const uint8_t* from, VoxelizeResult& result) const {
  const Bucketed& of = items_[number];
  const auto* const voxels = reinterpret_cast<const uint32_t*>(from);
  const auto* const begin = std::lower_bound(voxels, voxels + voxels_, of.first_voxel);
  const auto* const end = std::lower_bound(begin, voxels + voxels_, of.voxel_end);
  const auto listed = uint64_t(end - begin);
  VOXELPIPE_OK_OR_RETURN(Widen(begin, listed, of.first_voxel, result.voxels));
  if (listed == 0) {
    constexpr uint32_t kNone = 0;
    VOXELPIPE_OK_OR_RETURN(Widen(&kNone, 1, 0, result.offsets));
  } else {
    const auto* const offsets = reinterpret_cast<const uint32_t*>(from + offsets_at_) + (begin - voxels);
    VOXELPIPE_OK_OR_RETURN(Widen(offsets, listed + 1, of.first_fragment, result.offsets));
  }
  VOXELPIPE_OK_OR_RETURN(Copy(from + triangles_at_ + of.first_fragment * sizeof(uint32_t),
                              of.fragments * sizeof(uint32_t), result.triangles));
  for (size_t t = 0; t < result.specs.size(); ++t) {
    HostBuffer& values = result.targets.emplace_back();
    if (!of.shades) {
      VOXELPIPE_OK_OR_RETURN(Ones(of.fragments, values));
    } else {
      VOXELPIPE_OK_OR_RETURN(Copy(from + (values_at_.empty() ? 0 : values_at_[of.first_target + t]),
                                  TargetBytes(result.specs[t], of.fragments), values));
    }
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
