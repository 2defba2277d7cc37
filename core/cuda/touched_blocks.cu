#include "cuda/touched_blocks.h"

#include "cuda/blend_store.h"
#include "cuda/cells.h"
#include "cuda/divisor.h"
#include "cuda/warp_sum.cuh"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;

struct CountTouchedArgs {
  TouchedBlocks touched;
  uint32_t words = 0;  // of marks, four blocks each
  Divisor by_pitch, by_rows;
  const uint32_t* cells = nullptr;  // of the target
  uint32_t dims[3] = {};            // of the slab
  uint64_t* count = nullptr;
  uint32_t* large_queue = nullptr;  // as RestArgs has it
  uint64_t* queued = nullptr;
};

constexpr uint32_t kWidth = 1 << TouchedBlocks::kLogX, kSide = 1 << TouchedBlocks::kLogYZ;  // of a block

// Some rows of a block.
struct TouchedRows {
  uint32_t first[3];  // voxel of the slab
  uint32_t which;     // row y + kSide * z: bit
};

// The marks of a word's four blocks, and of the block before each along x: a byte each.
__device__ inline uint32_t MarksUpto(const uint8_t* row, uint32_t word) {
  const uint32_t here = reinterpret_cast<const uint32_t*>(row)[word];
  return here | here << 8 | (word > 0 ? row[4 * word - 1] : 0u);
}

// Visits what a word's four blocks have that is touched.
template <typename Visit>
__device__ inline void ForEachTouched(const CountTouchedArgs& args, uint32_t i, Visit&& visit) {
  static_assert(kSide == 4 && TouchedBlocks::kReach[1] == 2 && TouchedBlocks::kReach[2] == 2);
  static_assert(TouchedBlocks::kReach[0] <= int(kWidth) && kBlockSide <= TouchedBlocks::kReach[0]);
  constexpr uint32_t kAll = 0xffff, kFirstOfLayers = 0x1111, kFirstLayer = 0x000f, kFirst = 0x0001;
  const TouchedBlocks& touched = args.touched;
  const uint32_t row = Quotient(i, args.by_pitch), word = i - row * (touched.pitch / 4);
  const uint32_t z = Quotient(row, args.by_rows), y = row - z * touched.rows;
  const uint8_t* const marks = touched.marks + uint64_t{row} * touched.pitch;
  const uint32_t layer = touched.rows * touched.pitch;
  const uint32_t here = MarksUpto(marks, word);
  const uint32_t before_y = y > 0 ? MarksUpto(marks - touched.pitch, word) : 0;
  const uint32_t before_z = z > 0 ? MarksUpto(marks - layer, word) : 0;
  const uint32_t before_both = y > 0 && z > 0 ? MarksUpto(marks - layer - touched.pitch, word) : 0;
  if ((here | before_y | before_z | before_both) == 0) return;
  for (uint32_t b = 0; b < 4; ++b) {
    const auto marked = [b](uint32_t of) { return (of >> 8 * b & 0xff) != 0; };
    const uint32_t which = marked(here) ? kAll
                                        : (marked(before_y) ? kFirstOfLayers : 0) |
                                              (marked(before_z) ? kFirstLayer : 0) | (marked(before_both) ? kFirst : 0);
    if (which != 0) visit(TouchedRows{{(4 * word + b) * kWidth, y * kSide, z * kSide}, which});
  }
}

__device__ inline uint32_t CountNonzero(uint32_t cell) {
  return cell != 0 ? 1 : 0;
}
__device__ inline uint32_t CountNonzero(const uint4& cells) {
  return CountNonzero(cells.x) + CountNonzero(cells.y) + CountNonzero(cells.z) + CountNonzero(cells.w);
}

// The cells of some rows that are not 0, by the lanes of a warp, each of them a Cells at a time, of which a row of the slab has whole ones. All are
// asked for before any is waited for.
template <typename Cells>
__device__ inline uint32_t CountCells(const CountTouchedArgs& args, const TouchedRows& rows) {
  constexpr uint32_t kEach = sizeof(Cells) / sizeof(uint32_t), kLanes = kWidth / kEach;  // of a row
  constexpr uint32_t kRowsAtOnce = 32 / kLanes, kSteps = kSide * kSide / kRowsAtOnce;
  const uint32_t lane = threadIdx.x % 32, x = rows.first[0] + lane % kLanes * kEach, own = lane / kLanes;
  const uint64_t row = args.dims[0], layer = row * args.dims[1];
  const uint32_t y = rows.first[1] + own % kSide, z = rows.first[2] + own / kSide;
  const uint32_t* const cells = args.cells + (x + row * y + layer * z);
  const uint32_t which = x < args.dims[0] ? rows.which >> own : 0;
  Cells found[kSteps];
#pragma unroll
  for (uint32_t i = 0; i < kSteps; ++i) {
    const uint32_t dy = i * kRowsAtOnce % kSide, dz = i * kRowsAtOnce / kSide;
    const bool wanted = (which >> i * kRowsAtOnce & 1) != 0 && y + dy < args.dims[1] && z + dz < args.dims[2];
    found[i] = wanted ? *reinterpret_cast<const Cells*>(cells + (row * dy + layer * dz)) : Cells{};
  }
  uint32_t count = 0;
#pragma unroll
  for (uint32_t i = 0; i < kSteps; ++i) count += CountNonzero(found[i]);
  return count;
}

// Counts the cells of touched blocks that are not 0, and lets the first triangle alone wait for EmitLarge.
template <typename Cells>
__global__ void __launch_bounds__(kThreads) CountTouchedKernel(const __grid_constant__ CountTouchedArgs args) {
  __shared__ TouchedRows touched[4 * kThreads];  // warps take them in turn
  __shared__ uint32_t touched_count, counted;
  AllowNext();
  if (blockIdx.x == 0 && threadIdx.x == 0) {
    args.large_queue[0] = 0;
    args.queued[kLargeQueue] = 1;
  }
  if (threadIdx.x == 0) touched_count = counted = 0;
  __syncthreads();
  const uint32_t i = blockIdx.x * kThreads + threadIdx.x;
  if (i < args.words) {
    ForEachTouched(args, i, [&](const TouchedRows& rows) { touched[atomicAdd(&touched_count, 1u)] = rows; });
  }
  __syncthreads();
  uint32_t count = 0;
#pragma unroll 2
  for (uint32_t number = threadIdx.x / 32; number < touched_count; number += kThreads / 32) {
    count += CountCells<Cells>(args, touched[number]);
  }
  count = WarpSum(count);
  if (threadIdx.x % 32 == 0 && count > 0) atomicAdd(&counted, count);
  __syncthreads();
  if (threadIdx.x == 0 && counted > 0) atomicAdd(Counted(args.count), 0ull + counted);
}

// A writer of span_kernels.cuh: counts the voxels of rows whose cells are 0.
class BlankCounter {
 public:
  static constexpr bool kPartsInRow = false;
  struct Args {
    const uint32_t* cells = nullptr;
    uint32_t nx = 0;
    uint64_t* count = nullptr;
  };
  __device__ BlankCounter(const Args& args, uint32_t) : args_(args) {}

  __device__ void Put(uint32_t, uint32_t row, int x_begin, int x_end) {
    const uint64_t first = uint64_t{row} * args_.nx + uint32_t(x_begin);
    ForEachVoxel(x_begin < x_end ? uint32_t(x_end - x_begin) : 0, [&](int owner, uint32_t x, bool there) {
      const uint64_t n = __shfl_sync(~0u, first, owner) + x;
      if (there && args_.cells[n] == 0) ++blank_;
    });
  }
  __device__ void Finish() {
    __syncwarp();
    const uint64_t all = WarpSum(blank_);
    if (threadIdx.x % 32 == 0 && all > 0) atomicAdd(Counted(args_.count), 0ull + all);
  }

 private:
  const Args& args_;
  uint64_t blank_ = 0;
};

uint64_t BlocksAlong(int64_t n, int log) {
  return uint64_t((n + (int64_t{1} << log) - 1) >> log);
}
uint64_t Pitch(const RunState& state) {
  return (BlocksAlong(state.slab_dims[0], TouchedBlocks::kLogX) + 3) / 4 * 4;
}
uint64_t Rows(const RunState& state) {
  return BlocksAlong(state.slab_dims[1], TouchedBlocks::kLogYZ);
}
uint64_t MarkBytes(const RunState& state) {
  return Pitch(state) * Rows(state) * BlocksAlong(state.slab_dims[2], TouchedBlocks::kLogYZ);
}

}  // namespace

bool KeepsTouched(RunState& state) {
  const VoxelizeRequest& request = state.request.request;
  if (!state.direct || request.result != ResultKind::kDense || request.fill != Fill::kNone) return false;
  if (state.targets.count != 1 || state.fills_rows) return false;
  const CudaTarget& target = state.targets.at[0];
  return IsById(target) && target.blend == Blend::kMax && IsInPlace(target) && !NeedsOrder(state);
}

absl::Status ClearTouched(RunState& state) {
  VOXELPIPE_OK_OR_RETURN(state.touched.Resize(MarkBytes(state), state.stream));
  return state.touched.Fill(0, state.stream);
}

TouchedBlocks TouchedOf(RunState& state) {
  TouchedBlocks touched;
  if (!state.keeps_touched) return touched;
  touched.marks = state.touched.data();
  touched.pitch = uint32_t(Pitch(state));
  touched.rows = uint32_t(Rows(state));
  return touched;
}

absl::Status CountTouched(RunState& state) {
  if (state.mesh.host_view.triangle_count == 0) return absl::OkStatus();
  CountTouchedArgs args;
  args.touched = TouchedOf(state);
  args.words = uint32_t(MarkBytes(state) / 4);  // no more than a bit grid has: below 2^27, so that Quotient holds
  args.by_pitch = MakeDivisor(args.touched.pitch / 4);
  args.by_rows = MakeDivisor(args.touched.rows);
  args.cells = reinterpret_cast<const uint32_t*>(state.targets.at[0].dense);
  for (int a = 0; a < 3; ++a) args.dims[a] = uint32_t(state.slab_dims[size_t(a)]);
  args.count = state.counters.data() + kVoxels;
  RestArgs first = MakeRestArgs(state, 0, 1, false);
  first.walk.largest = nullptr;  // nothing is drawn apart
  args.large_queue = first.walk.large_queue;
  args.queued = first.walk.queued;
  const auto kernel = args.dims[0] % 4 == 0 ? CountTouchedKernel<uint4> : CountTouchedKernel<uint32_t>;
  kernel<<<BlocksFor(args.words, kThreads, UINT32_MAX), kThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("CountTouched");
  // The least id is what the target was cleared to.
  return EmitLargeQueue<BlankCounter>(state, first, {args.cells, args.dims[0], args.count});
}

}  // namespace voxelpipe::cuda
