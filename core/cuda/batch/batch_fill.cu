// Parity fill, and values of filled voxels, for all items of a batch.
#include <algorithm>

#include "cuda/batch/batch.h"
#include "cuda/batch/batch_kernel.cuh"
#include "cuda/fill/crossings.cuh"

namespace voxelpipe::cuda {
namespace {

// The counterpart of CrossingArgs for the triangles of a batch.
struct BatchToggleArgs {
  using View = ToggleView;
  BatchView batch;
  const uint32_t* triangles;
  const Vec3d* positions;
  uint64_t triangle_count;
  uint32_t* queue;
  uint64_t* queued;
};

__device__ inline bool ViewOf(const BatchToggleArgs& args, uint64_t t, ToggleView& view) {
  const BatchItemView& item = args.batch.items[args.batch.item_of[t]];
  if (!item.parity) return false;
  view.grid = item.grid;
  view.inside = args.batch.inside + item.first_word;
  view.columns = args.batch.columns + item.first_column;
  view.column_words = item.column_words;
  return true;
}

__global__ void __launch_bounds__(kFillThreads) SuffixXorBatch(const __grid_constant__ BatchView batch) {
  const uint64_t warps = uint64_t(gridDim.x) * (kFillThreads / 32);
  for (uint64_t row = uint64_t(blockIdx.x) * (kFillThreads / 32) + threadIdx.x / 32; row < batch.row_count;
       row += warps) {
    const BatchItemView& item = batch.items[ItemAt(batch, &BatchItemView::first_row, row)];
    if (!item.parity) continue;
    const int64_t words = item.grid.words_per_row;
    SuffixXorRow(batch.inside + item.first_word + (row - item.first_row) * uint64_t(words), words);
  }
}

// gridDim.x distributes targets with values, gridDim.y the words of each.
__global__ void __launch_bounds__(kFillThreads) FillBatchValues(const __grid_constant__ BatchView batch) {
  const uint64_t begin = uint64_t(blockIdx.y) * (kFillThreads / 32) + threadIdx.x / 32,
                 step = uint64_t(gridDim.y) * (kFillThreads / 32);
  for (uint32_t i = blockIdx.x; i < batch.value_count; i += gridDim.x) {
    const BatchValueView& values = batch.values[i];
    const BatchItemView& item = batch.items[values.item];
    if (!item.filled()) continue;
    FillArgs args;
    args.dense = values.at;
    args.components = values.components;
    args.fill = values.fill;
    args.inside = batch.inside + item.first_word;
    args.present = values.present == nullptr ? batch.bits + item.first_word : values.present;
    args.words = item.words;
    args.voxels = values.voxels;
    args.nx = item.grid.dims[0];
    args.ny = item.grid.dims[1];
    args.first_layer = 0;
    args.words_per_row = item.grid.words_per_row;
    args.planar = values.planar;
    switch (values.element_bytes) {
      case 1: FillWords<uint8_t>(args, begin, step); break;
      case 2: FillWords<uint16_t>(args, begin, step); break;
      default: FillWords<uint32_t>(args, begin, step); break;
    }
  }
}

// Inside voxels and odd columns of items with parity fill.
absl::Status ParityBatch(const BatchState& state) {
  const BatchView& batch = state.view;
  BatchToggleArgs args;
  args.batch = batch;
  args.triangles = batch.triangles;
  args.positions = batch.placed;
  args.triangle_count = batch.triangle_count;
  args.queue = batch.queue[0];
  args.queued = batch.queued + kBatchFill;
  // Small grids: few lines of each triangle.
  VOXELPIPE_OK_OR_RETURN(Toggle(args, state.device, 1, state.stream));
  SuffixXorBatch<<<BlocksFor(batch.row_count, kFillThreads / 32), kFillThreads, 0, state.stream>>>(batch);
  VOXELPIPE_LAUNCHED_OR_RETURN("SuffixXorBatch");
  return absl::OkStatus();
}

}  // namespace

absl::Status FillBatch(const BatchState& state) {
  const BatchView& batch = state.view;
  if (!batch.any_fill() || batch.triangle_count == 0) return absl::OkStatus();
  if (batch.any_parity) VOXELPIPE_OK_OR_RETURN(ParityBatch(state));
  if (batch.value_count == 0) return absl::OkStatus();
  FillBatchValues<<<dim3(std::min(batch.value_count, 1u << 16), 4), kFillThreads, 0, state.stream>>>(batch);
  VOXELPIPE_LAUNCHED_OR_RETURN("FillBatchValues");
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
