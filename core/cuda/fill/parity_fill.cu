// Parity fill: one toggled bit per crossing, then a suffix exclusive-or along each row. Nonzero fill: a sum of signs
// per crossing, then suffix sums. Also stores the values of filled voxels.
//
// Source: the fill of M. Schwarz and H.-P. Seidel, "Fast Parallel Surface and Solid Voxelization on GPUs", 2010,
// section 5. Differences: crossings are counted per edge (raster/crossing.h), so closed meshes leave no streaks; a
// single bit is toggled per crossing and spread at the end.
#include <algorithm>

#include "cuda/device/launch.cuh"
#include "cuda/fill/crossings.cuh"
#include "cuda/primitives/list_sizes.h"
#include "cuda/run/run_state.h"
#include "pipeline/stages/target_rules.h"

namespace voxelpipe::cuda {
namespace {

__global__ void __launch_bounds__(kFillThreads) SuffixXor(uint32_t* bits, uint64_t rows, int64_t words) {
  const uint64_t warps = uint64_t(gridDim.x) * (kFillThreads / 32);
  for (uint64_t row = uint64_t(blockIdx.x) * (kFillThreads / 32) + threadIdx.x / 32; row < rows; row += warps) {
    SuffixXorRow(bits + row * uint64_t(words), words);
  }
}

// Suffix sums: bit i of a row is set if the sums at i and beyond do not add up to 0; rows with a non-zero total are
// counted as odd columns. One warp per row, from its end.
__global__ void __launch_bounds__(kFillThreads)
    SpreadSums(const __grid_constant__ SumView view, uint64_t* odd_columns) {
  const int lane = int(threadIdx.x % 32);
  const int64_t words = view.grid.words_per_row;
  const uint64_t warps = uint64_t(gridDim.x) * (kFillThreads / 32);
  for (uint64_t row = view.first_row + uint64_t(blockIdx.x) * (kFillThreads / 32) + threadIdx.x / 32;
       row < view.end_row; row += warps) {
    uint32_t* const at = view.inside + row * uint64_t(words);
    const uint32_t* const sums = view.sums + (row - view.first_row) * uint64_t(words) * 32;
    uint32_t beyond = 0;
    for (int64_t end = words; end > 0; end -= 32) {
      const int64_t first = end - 32;
      uint32_t word = first + lane >= 0 ? at[first + lane] : 0;
      const uint32_t some = __ballot_sync(~0u, word != 0);
      for (int k = 31; k >= 0; --k) {  // words, from the last to the first
        const uint32_t marked = __shfl_sync(~0u, word, k);
        uint32_t inside = beyond != 0 ? ~0u : 0;
        if ((some >> k & 1) != 0) {
          uint32_t sum = (marked >> lane & 1) != 0 ? sums[(first + k) * 32 + lane] : 0;
          for (int by = 1; by < 32; by *= 2) {
            const uint32_t other = __shfl_down_sync(~0u, sum, by);
            if (lane + by < 32) sum += other;
          }
          inside = __ballot_sync(~0u, sum + beyond != 0);
          beyond += __shfl_sync(~0u, sum, 0);
        }
        if (lane == k) word = inside;
      }
      if (first + lane >= 0) at[first + lane] = word;
    }
    if (lane == 0 && beyond + view.outside[row - view.first_row] != 0) {
      atomicAdd(reinterpret_cast<unsigned long long*>(odd_columns), 1ull);
    }
  }
}

template <typename Element>
__global__ void __launch_bounds__(kFillThreads) FillValues(const __grid_constant__ FillArgs args) {
  FillWords<Element>(args, uint64_t(blockIdx.x) * (kFillThreads / 32) + threadIdx.x / 32,
                     uint64_t(gridDim.x) * (kFillThreads / 32));
}

absl::Status FillTarget(RunState& state, int index) {
  const CudaTarget& target = state.targets.at[index];
  FillArgs args;
  args.dense = target.dense;
  args.components = target.components;
  args.fill = FillValueOf(state.request, size_t(index), state.grid);
  args.inside = state.inside.data();
  if (const auto& of_parts = state.parts.fills[size_t(index)]; !of_parts.empty()) {
    args.of_parts = of_parts.data();
    args.ranks = state.parts.inside_ranks.data();
  }
  args.present = target.own_presence ? target.presence : state.coverage.data();
  args.words = state.slab_words();
  args.voxels = state.slab_voxels();
  args.nx = state.view.dims[0];
  args.ny = state.view.dims[1];
  args.first_layer = state.view.slab_begin;
  args.words_per_row = state.view.words_per_row;
  args.planar = state.targets.planar;
  const unsigned blocks = BlocksFor(args.words, kFillThreads / 32);
  switch (target.format) {
    case VoxelFormat::kU8:
    case VoxelFormat::kU8Srgb:
    case VoxelFormat::kU8Snorm: FillValues<uint8_t><<<blocks, kFillThreads, 0, state.stream>>>(args); break;
    case VoxelFormat::kU16:
    case VoxelFormat::kU16Snorm:
    case VoxelFormat::kF16: FillValues<uint16_t><<<blocks, kFillThreads, 0, state.stream>>>(args); break;
    default: FillValues<uint32_t><<<blocks, kFillThreads, 0, state.stream>>>(args); break;
  }
  VOXELPIPE_LAUNCHED_OR_RETURN("FillValues");
  return absl::OkStatus();
}

}  // namespace

absl::Status ParityInside(RunState& state) {
  const uint64_t triangles = state.mesh.host_view.triangle_count;
  VOXELPIPE_OK_OR_RETURN(state.inside.Fill(0, state.stream));
  if (triangles == 0) return absl::OkStatus();
  VOXELPIPE_OK_OR_RETURN(PlaceVertices(state));
  ToggleArgs args;
  args.view.column_words = (state.view.dims[1] + 31) / 32;
  DeviceArray<uint32_t> columns;
  VOXELPIPE_OK_OR_RETURN(columns.Resize(uint64_t(args.view.column_words) * uint64_t(state.slab.depth()), state.stream));
  VOXELPIPE_OK_OR_RETURN(columns.Fill(0, state.stream));
  VOXELPIPE_OK_OR_RETURN(state.queue[0].Resize(triangles, state.stream));
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kQueued0, kQueued1}));
  args.view.grid = state.view;
  args.triangles = state.mesh.triangle_list();
  args.positions = state.mesh.index_positions.data();
  args.triangle_count = triangles;
  args.view.inside = state.inside.data();
  args.view.columns = columns.data();
  args.queue = state.queue[0].data();
  args.queued = state.counters.data() + kQueued0;
  VOXELPIPE_OK_OR_RETURN(Toggle(args, state.device, 8, state.stream));
  VOXELPIPE_OK_OR_RETURN(CountBits(state, columns.data(), nullptr, columns.size(), kOddColumns));
  SuffixXor<<<BlocksFor(state.slab_rows(), kFillThreads / 32), kFillThreads, 0, state.stream>>>(
      state.inside.data(), state.slab_rows(), state.view.words_per_row);
  VOXELPIPE_LAUNCHED_OR_RETURN("SuffixXor");
  return absl::OkStatus();
}

absl::Status NonzeroInside(RunState& state) {
  const uint64_t triangles = state.mesh.host_view.triangle_count, rows = state.slab_rows();
  VOXELPIPE_OK_OR_RETURN(state.inside.Fill(0, state.stream));
  if (triangles == 0) return absl::OkStatus();
  VOXELPIPE_OK_OR_RETURN(PlaceVertices(state));
  VOXELPIPE_OK_OR_RETURN(state.queue[0].Resize(triangles, state.stream));
  const uint64_t of_row = uint64_t(state.view.words_per_row) * 32;
  const uint64_t at_once = std::clamp<uint64_t>(kMaxSumBytes / (of_row * sizeof(uint32_t)), 1, rows);
  DeviceArray<uint32_t> sums, outside;
  VOXELPIPE_OK_OR_RETURN(sums.Resize(at_once * of_row, state.stream));
  VOXELPIPE_OK_OR_RETURN(outside.Resize(at_once, state.stream));
  SumArgs args;
  args.view.grid = state.view;
  args.view.inside = state.inside.data();
  args.view.sums = sums.data();
  args.view.outside = outside.data();
  args.triangles = state.mesh.triangle_list();
  args.positions = state.mesh.index_positions.data();
  args.triangle_count = triangles;
  args.queue = state.queue[0].data();
  for (uint64_t row = 0; row < rows; row += at_once) {
    VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kQueued0, kQueued1}));
    VOXELPIPE_OK_OR_RETURN(sums.Fill(0, state.stream));
    VOXELPIPE_OK_OR_RETURN(outside.Fill(0, state.stream));
    args.queued = state.counters.data() + kQueued0;
    args.view.first_row = row;
    args.view.end_row = std::min(rows, row + at_once);
    VOXELPIPE_OK_OR_RETURN(Toggle(args, state.device, 8, state.stream));
    SpreadSums<<<BlocksFor(args.view.end_row - row, kFillThreads / 32), kFillThreads, 0, state.stream>>>(
        args.view, state.counters.data() + kOddColumns);
    VOXELPIPE_LAUNCHED_OR_RETURN("SpreadSums");
  }
  return absl::OkStatus();
}

absl::Status SolidFill(RunState& state) {
  const VoxelizeRequest& request = state.request.request;
  if (state.parts.filled) {  // FindOwners found the inside
    VOXELPIPE_OK_OR_RETURN(CountOwned(state));
  } else {
    VOXELPIPE_OK_OR_RETURN(state.inside.Resize(state.slab_words(), state.stream));
    VOXELPIPE_OK_OR_RETURN(request.fill == Fill::kFlood     ? FloodInside(state)
                           : request.fill == Fill::kNonzero ? NonzeroInside(state)
                                                            : ParityInside(state));
  }
  if (request.result == ResultKind::kSparse) return absl::OkStatus();  // MakeBricks fills the bricks
  for (int t = 0; t < state.targets.count; ++t) {
    if (state.targets.at[t].format != VoxelFormat::kBit) VOXELPIPE_OK_OR_RETURN(FillTarget(state, t));
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
