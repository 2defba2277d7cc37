// Targets of a batch: clears values, packs bits, counts occupied voxels.
#include <algorithm>

#include "cuda/batch/batch.h"
#include "cuda/batch/batch_kernel.cuh"
#include "cuda/device/launch.cuh"
#include "cuda/targets/pack_kernels.cuh"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;

// Packs all targets of a batch, one thread per word.
__global__ void __launch_bounds__(kThreads) PackBatchKernel(const __grid_constant__ BatchView batch) {
  for (uint64_t w = uint64_t(blockIdx.x) * kThreads + threadIdx.x; w < batch.packed_words;
       w += uint64_t(gridDim.x) * kThreads) {
    const BatchTargetView& target =
        batch.targets[LastAt(batch.targets, batch.target_count, &BatchTargetView::first_packed, w)];
    const BatchItemView& item = batch.items[target.item];
    PackArgs a;
    const uint32_t* const coverage = batch.bits + item.first_word;
    a.present = target.present == nullptr ? coverage : target.present;
    a.value = target.value == nullptr ? coverage : target.value;
    a.inside = item.filled() ? batch.inside + item.first_word : nullptr;
    a.clear = target.clear;
    a.fill = target.fill;
    a.nx = item.grid.dims[0];
    a.words_per_row = item.grid.words_per_row;
    a.voxels = target.voxels;
    batch.packed[w] = PackedWord(a, w - target.first_packed);
  }
}

// gridDim.x distributes targets with values, gridDim.y the words of each.
__global__ void __launch_bounds__(kThreads) ClearBatchKernel(const __grid_constant__ BatchView batch) {
  const uint64_t begin = uint64_t(blockIdx.y) * kThreads + threadIdx.x, step = uint64_t(gridDim.y) * kThreads;
  for (uint32_t i = blockIdx.x; i < batch.value_count; i += gridDim.x) {
    const BatchValueView& values = batch.values[i];
    uint32_t pattern = values.clear_stored;
    if (values.element_bytes == 1) pattern *= 0x01010101u;
    if (values.element_bytes == 2) pattern *= 0x00010001u;
    auto* const words = reinterpret_cast<uint32_t*>(values.at);
    for (uint64_t w = begin; w < values.words; w += step) words[w] = pattern;
  }
}

// gridDim.x distributes items, gridDim.y the words of each.
__global__ void __launch_bounds__(kThreads) CountBatchKernel(const __grid_constant__ BatchView batch) {
  const uint64_t begin = uint64_t(blockIdx.y) * kThreads + threadIdx.x, step = uint64_t(gridDim.y) * kThreads;
  for (uint32_t i = blockIdx.x; i < batch.item_count; i += gridDim.x) {
    const BatchItemView& item = batch.items[i];
    AddBits(batch.bits + item.first_word, item.filled() ? batch.inside + item.first_word : nullptr, item.words, begin,
            step, &batch.counts[i].occupied);
    if (item.parity) {
      const uint64_t columns = uint64_t(item.column_words) * uint64_t(item.grid.dims[2]);
      AddBits(batch.columns + item.first_column, nullptr, columns, begin, step, &batch.counts[i].odd_columns);
    }
  }
}

}  // namespace

absl::Status ClearBatch(const BatchState& state) {
  const BatchView& batch = state.view;
  if (batch.value_count == 0) return absl::OkStatus();
  ClearBatchKernel<<<dim3(std::min(batch.value_count, 1u << 16), 8), kThreads, 0, state.stream>>>(batch);
  VOXELPIPE_LAUNCHED_OR_RETURN("ClearBatchKernel");
  return absl::OkStatus();
}

absl::Status PackBatch(const BatchState& state) {
  const BatchView& batch = state.view;
  CountBatchKernel<<<dim3(std::min(batch.item_count, 1u << 16), 4), kThreads, 0, state.stream>>>(batch);
  VOXELPIPE_LAUNCHED_OR_RETURN("CountBatchKernel");
  if (batch.packed_words == 0) return absl::OkStatus();
  PackBatchKernel<<<BlocksFor(batch.packed_words, kThreads), kThreads, 0, state.stream>>>(batch);
  VOXELPIPE_LAUNCHED_OR_RETURN("PackBatchKernel");
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
