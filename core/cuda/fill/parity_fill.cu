// Parity fill: one toggled bit a crossing, then a suffix exclusive-or along each row. Nonzero fill: a sum of signs a
// crossing, then suffix sums. And the filled voxels' values.
//
// Source: the fill of M. Schwarz and H.-P. Seidel, "Fast Parallel Surface and Solid Voxelization on GPUs", 2010,
// section 5. Changed: crossings are counted per edge (raster/crossing.h), so that closed meshes leave no streaks; a
// single bit is toggled and spread at the end.
#include <algorithm>

#include "cuda/batch/batch.h"
#include "cuda/batch/batch_kernel.cuh"
#include "cuda/device/launch.cuh"
#include "cuda/primitives/list_sizes.h"
#include "cuda/run/run_state.h"
#include "cuda/traversal/row_traversal.cuh"
#include "pipeline/stages/target_rules.h"
#include "raster/crossing.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;
constexpr uint32_t kLinesOfThread = 32;

// Where the crossings of a triangle go.
struct ToggleView {
  GridView grid;
  uint32_t* inside = nullptr;  // bit grid of the slab
  // One bit a column (j, k) of the slab: the parity of all its crossings; rows of column_words words.
  uint32_t* columns = nullptr;
  int64_t column_words = 0;
};

// Where the signs of a triangle's crossings go: those with some of the slab's rows, which are numbered as in bit grids.
struct SumView {
  GridView grid;
  uint64_t first_row = 0, end_row = 0;
  uint32_t* inside = nullptr;  // bit grid of the slab: the last voxel before a crossing, where there is one
  // Of these rows, modulo 2^32, +1 for a crossing that rises and -1 for one that falls: by that voxel's bit, and by row
  // those before all voxels.
  uint32_t *sums = nullptr, *outside = nullptr;
};

// A run's triangles, and the view that all of them have.
template <typename ViewType>
struct CrossingArgs {
  using View = ViewType;
  View view;
  const uint32_t* triangles;
  const Vec3d* positions;  // index space
  uint64_t triangle_count;
  uint32_t* queue;
  uint64_t* queued;
};
using ToggleArgs = CrossingArgs<ToggleView>;
using SumArgs = CrossingArgs<SumView>;
// The same for the triangles of a batch.
struct BatchToggleArgs {
  using View = ToggleView;
  BatchView batch;
  const uint32_t* triangles;
  const Vec3d* positions;
  uint64_t triangle_count;
  uint32_t* queue;
  uint64_t* queued;
};

// Whether the triangle's mesh is filled, and where its crossings go.
template <typename View>
__device__ inline bool ViewOf(const CrossingArgs<View>& args, uint64_t, View& view) {
  view = args.view;
  return true;
}
__device__ inline bool ViewOf(const BatchToggleArgs& args, uint64_t t, ToggleView& view) {
  const BatchItemView& item = args.batch.items[args.batch.item_of[t]];
  if (!item.parity) return false;
  view.grid = item.grid;
  view.inside = args.batch.inside + item.first_word;
  view.columns = args.batch.columns + item.first_column;
  view.column_words = item.column_words;
  return true;
}

// The lines along x, through the centres of (y, z), that may cross the triangle.
struct Lines {
  int64_t y_begin, y_end, z_begin, z_end;
  __device__ uint64_t count() const {
    return y_begin < y_end && z_begin < z_end ? uint64_t(y_end - y_begin) * uint64_t(z_end - z_begin) : 0;
  }
};

struct Corners {
  Vec3d a, b, c;
};

template <typename Args>
__device__ inline Corners Load(const Args& args, uint64_t t) {
  const uint32_t* v = args.triangles + 3 * t;
  return {args.positions[v[0]], args.positions[v[1]], args.positions[v[2]]};
}

__device__ inline void CentreRange(double lo, double hi, int64_t first, int64_t last, int64_t& begin, int64_t& end) {
  begin = int64_t(Clamp(floor(lo - 0.5), double(first), double(last)));
  end = int64_t(Clamp(ceil(hi - 0.5) + 1, double(first), double(last)));
}

__device__ inline Lines LinesOf(const ToggleView& args, const Corners& t) {
  Lines lines;
  CentreRange(Min(t.a.y, Min(t.b.y, t.c.y)), Max(t.a.y, Max(t.b.y, t.c.y)), 0, args.grid.dims[1], lines.y_begin,
              lines.y_end);
  CentreRange(Min(t.a.z, Min(t.b.z, t.c.z)), Max(t.a.z, Max(t.b.z, t.c.z)), args.grid.slab_begin, args.grid.slab_end,
              lines.z_begin, lines.z_end);
  return lines;
}

__device__ inline Lines LinesOf(const SumView& args, const Corners& t) {
  const auto ny = uint64_t(args.grid.dims[1]);
  const int64_t first = args.grid.slab_begin + int64_t(args.first_row / ny);
  const int64_t last = args.grid.slab_begin + int64_t((args.end_row - 1) / ny);
  Lines lines;
  CentreRange(Min(t.a.y, Min(t.b.y, t.c.y)), Max(t.a.y, Max(t.b.y, t.c.y)), 0, args.grid.dims[1], lines.y_begin,
              lines.y_end);
  CentreRange(Min(t.a.z, Min(t.b.z, t.c.z)), Max(t.a.z, Max(t.b.z, t.c.z)), first, last + 1, lines.z_begin,
              lines.z_end);
  return lines;
}

__device__ inline void ToggleLine(const SumView& args, const Corners& t, int64_t y, int64_t z) {
  const uint64_t row = uint64_t(y + args.grid.dims[1] * (z - args.grid.slab_begin));
  if (row < args.first_row || row >= args.end_row) return;
  const double py = double(y) + 0.5, pz = double(z) + 0.5;
  if (!LineCrosses(t.a, t.b, t.c, py, pz)) return;
  const uint32_t sign = CrossingFalls(t.a, t.b, t.c, py, pz) ? ~0u : 1u;
  const TrianglePlane plane = SetUpPlane(t.a, t.b, t.c);
  const int64_t before = CentresBefore(CrossingX(plane, t.a, t.b, t.c, py, pz), args.grid.dims[0]);
  const uint64_t here = row - args.first_row;
  if (before == 0) {
    atomicAdd(args.outside + here, sign);
    return;
  }
  atomicOr(args.inside + args.grid.Word(before - 1, y, z), 1u << ((before - 1) % 32));
  atomicAdd(args.sums + here * uint64_t(args.grid.words_per_row) * 32 + uint64_t(before - 1), sign);
}

__device__ inline void ToggleLine(const ToggleView& args, const Corners& t, int64_t y, int64_t z) {
  const double py = double(y) + 0.5, pz = double(z) + 0.5;
  if (!LineCrosses(t.a, t.b, t.c, py, pz)) return;
  atomicXor(args.columns + (z - args.grid.slab_begin) * args.column_words + y / 32, 1u << (y % 32));
  const TrianglePlane plane = SetUpPlane(t.a, t.b, t.c);
  const int64_t before = CentresBefore(CrossingX(plane, t.a, t.b, t.c, py, pz), args.grid.dims[0]);
  if (before > 0) atomicXor(args.inside + args.grid.Word(before - 1, y, z), 1u << ((before - 1) % 32));
}

// A triangle a thread; those with many lines are queued.
template <typename Args>
__global__ void __launch_bounds__(kThreads) ToggleSmall(const __grid_constant__ Args args) {
  __shared__ unsigned long long room[kThreads / 32 + 1];
  const uint64_t t = uint64_t(blockIdx.x) * kThreads + threadIdx.x;
  bool queue = false;
  typename Args::View view;
  if (t < args.triangle_count && ViewOf(args, t, view)) {
    const Corners corners = Load(args, t);
    const Lines lines = LinesOf(view, corners);
    const uint64_t count = lines.count();
    queue = count > kLinesOfThread;
    if (count > 0 && !queue) {
      for (int64_t z = lines.z_begin; z < lines.z_end; ++z) {
        for (int64_t y = lines.y_begin; y < lines.y_end; ++y) ToggleLine(view, corners, y, z);
      }
    }
  }
  if (__syncthreads_or(queue) == 0) return;
  const uint64_t at = BlockAllocate<kThreads>(args.queued, queue, room);
  if (queue) args.queue[at] = uint32_t(t);
}

// Blocks in x share a queued triangle's lines, blocks in y take different triangles.
template <typename Args>
__global__ void __launch_bounds__(kThreads) ToggleLarge(const __grid_constant__ Args args) {
  const uint64_t queued = *args.queued;
  for (uint64_t i = blockIdx.y; i < queued; i += gridDim.y) {
    typename Args::View view;
    ViewOf(args, args.queue[i], view);
    const Corners corners = Load(args, args.queue[i]);
    const Lines lines = LinesOf(view, corners);
    const uint64_t count = lines.count(), ny = uint64_t(lines.y_end - lines.y_begin);
    for (uint64_t line = uint64_t(blockIdx.x) * kThreads + threadIdx.x; line < count;
         line += uint64_t(gridDim.x) * kThreads) {
      ToggleLine(view, corners, lines.y_begin + int64_t(line % ny), lines.z_begin + int64_t(line / ny));
    }
  }
}

// Bit i of a row becomes the parity of the toggles at i and beyond. All lanes of a warp share a row, from its end.
__device__ inline void SuffixXorRow(uint32_t* at, int64_t words) {
  const int lane = int(threadIdx.x % 32);
  uint32_t carry = 0;  // all bits set where an odd number of toggles lies beyond
  for (int64_t end = words; end > 0; end -= 32) {
    const int64_t w = end - 32 + lane;
    uint32_t word = w >= 0 ? at[w] : 0;
    const uint32_t odd = __ballot_sync(~0u, __popc(word) & 1);
    if (odd == 0 && carry == 0 && __ballot_sync(~0u, word != 0) == 0) continue;
    for (int shift = 1; shift < 32; shift *= 2) word ^= word >> shift;
    const uint32_t beyond = lane == 31 ? 0 : odd >> (lane + 1);
    if ((__popc(beyond) & 1) != 0) word = ~word;
    if (w >= 0) at[w] = word ^ carry;
    if ((__popc(odd) & 1) != 0) carry = ~carry;
  }
}

__global__ void __launch_bounds__(kThreads) SuffixXor(uint32_t* bits, uint64_t rows, int64_t words) {
  const uint64_t warps = uint64_t(gridDim.x) * (kThreads / 32);
  for (uint64_t row = uint64_t(blockIdx.x) * (kThreads / 32) + threadIdx.x / 32; row < rows; row += warps) {
    SuffixXorRow(bits + row * uint64_t(words), words);
  }
}

__global__ void __launch_bounds__(kThreads) SuffixXorBatch(const __grid_constant__ BatchView batch) {
  const uint64_t warps = uint64_t(gridDim.x) * (kThreads / 32);
  for (uint64_t row = uint64_t(blockIdx.x) * (kThreads / 32) + threadIdx.x / 32; row < batch.row_count; row += warps) {
    const BatchItemView& item = batch.items[ItemAt(batch, &BatchItemView::first_row, row)];
    if (!item.parity) continue;
    const int64_t words = item.grid.words_per_row;
    SuffixXorRow(batch.inside + item.first_word + (row - item.first_row) * uint64_t(words), words);
  }
}

// Bit i of a row becomes whether the sums at i and beyond do not sum to 0; rows whose signs do not are counted. A warp
// a row, from its end.
__global__ void __launch_bounds__(kThreads) SpreadSums(const __grid_constant__ SumView view, uint64_t* odd_columns) {
  const int lane = int(threadIdx.x % 32);
  const int64_t words = view.grid.words_per_row;
  const uint64_t warps = uint64_t(gridDim.x) * (kThreads / 32);
  for (uint64_t row = view.first_row + uint64_t(blockIdx.x) * (kThreads / 32) + threadIdx.x / 32; row < view.end_row;
       row += warps) {
    uint32_t* const at = view.inside + row * uint64_t(words);
    const uint32_t* const sums = view.sums + (row - view.first_row) * uint64_t(words) * 32;
    uint32_t beyond = 0;
    for (int64_t end = words; end > 0; end -= 32) {
      const int64_t first = end - 32;
      uint32_t word = first + lane >= 0 ? at[first + lane] : 0;
      const uint32_t some = __ballot_sync(~0u, word != 0);
      for (int k = 31; k >= 0; --k) {  // words, from the last
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

struct FillArgs {
  uint8_t* dense;
  int components;
  FillValue fill;
  const uint32_t *inside, *present;  // bit grids of the slab
  uint64_t words, voxels;
  int64_t nx, ny, first_layer, words_per_row;
  bool planar;
};

// The fill value, to the filled voxels of words begin, begin + step, ... without a fragment of the target: a warp a
// word, a lane a voxel.
template <typename Element>
__device__ inline void FillWords(const FillArgs& args, uint64_t begin, uint64_t step) {
  auto* const out = reinterpret_cast<Element*>(args.dense);
  const auto components = uint64_t(args.components);
  const unsigned lane = threadIdx.x % 32;
  for (uint64_t word = begin; word < args.words; word += step) {
    if (((args.inside[word] & ~args.present[word]) >> lane & 1) == 0) continue;
    const uint64_t row = word / uint64_t(args.words_per_row), w = word % uint64_t(args.words_per_row);
    const uint64_t n = row * uint64_t(args.nx) + w * 32 + lane;
    int64_t y = 0, z = 0;
    if (args.fill.kind != FillValue::Kind::kStored) {
      y = int64_t(row % uint64_t(args.ny));
      z = int64_t(row / uint64_t(args.ny)) + args.first_layer;
    }
    for (uint64_t c = 0; c < components; ++c) {
      const uint32_t stored = FillStored(args.fill, int64_t(w * 32 + lane), y, z, int(c));
      out[args.planar ? c * args.voxels + n : n * components + c] = Element(stored);
    }
  }
}

template <typename Element>
__global__ void __launch_bounds__(kThreads) FillValues(const __grid_constant__ FillArgs args) {
  FillWords<Element>(args, uint64_t(blockIdx.x) * (kThreads / 32) + threadIdx.x / 32,
                     uint64_t(gridDim.x) * (kThreads / 32));
}

// Blocks in x take a target's values each, blocks in y share its words.
__global__ void __launch_bounds__(kThreads) FillBatchValues(const __grid_constant__ BatchView batch) {
  const uint64_t begin = uint64_t(blockIdx.y) * (kThreads / 32) + threadIdx.x / 32,
                 step = uint64_t(gridDim.y) * (kThreads / 32);
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

absl::Status FillTarget(RunState& state, int index) {
  const CudaTarget& target = state.targets.at[index];
  FillArgs args;
  args.dense = target.dense;
  args.components = target.components;
  args.fill = FillValueOf(state.request, size_t(index), state.grid);
  args.inside = state.inside.data();
  args.present = target.own_presence ? target.presence : state.coverage.data();
  args.words = state.slab_words();
  args.voxels = state.slab_voxels();
  args.nx = state.view.dims[0];
  args.ny = state.view.dims[1];
  args.first_layer = state.view.slab_begin;
  args.words_per_row = state.view.words_per_row;
  args.planar = state.targets.planar;
  const unsigned blocks = BlocksFor(args.words, kThreads / 32);
  switch (target.format) {
    case VoxelFormat::kU8:
    case VoxelFormat::kU8Srgb: FillValues<uint8_t><<<blocks, kThreads, 0, state.stream>>>(args); break;
    case VoxelFormat::kU16:
    case VoxelFormat::kF16: FillValues<uint16_t><<<blocks, kThreads, 0, state.stream>>>(args); break;
    default: FillValues<uint32_t><<<blocks, kThreads, 0, state.stream>>>(args); break;
  }
  VOXELPIPE_LAUNCHED_OR_RETURN("FillValues");
  return absl::OkStatus();
}

// `share`: blocks that share a queued triangle.
template <typename Args>
absl::Status Toggle(const Args& args, const DeviceInfo& device, unsigned share, cudaStream_t stream) {
  ToggleSmall<<<unsigned((args.triangle_count + kThreads - 1) / kThreads), kThreads, 0, stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ToggleSmall");
  ToggleLarge<<<dim3(share, unsigned(device.multiprocessors) * 8 / share), kThreads, 0, stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ToggleLarge");
  return absl::OkStatus();
}

// The inside of items with parity fill, and their odd columns.
absl::Status ParityBatch(const BatchState& state) {
  const BatchView& batch = state.view;
  BatchToggleArgs args;
  args.batch = batch;
  args.triangles = batch.triangles;
  args.positions = batch.placed;
  args.triangle_count = batch.triangle_count;
  args.queue = batch.queue[0];
  args.queued = batch.queued + kBatchFill;
  VOXELPIPE_OK_OR_RETURN(Toggle(args, state.device, 1, state.stream));  // small grids: many queued, each with few lines
  SuffixXorBatch<<<BlocksFor(batch.row_count, kThreads / 32), kThreads, 0, state.stream>>>(batch);
  VOXELPIPE_LAUNCHED_OR_RETURN("SuffixXorBatch");
  return absl::OkStatus();
}

}  // namespace

absl::Status FillBatch(const BatchState& state) {
  const BatchView& batch = state.view;
  if (!batch.any_fill() || batch.triangle_count == 0) return absl::OkStatus();
  if (batch.any_parity) VOXELPIPE_OK_OR_RETURN(ParityBatch(state));
  if (batch.value_count == 0) return absl::OkStatus();
  FillBatchValues<<<dim3(std::min(batch.value_count, 1u << 16), 4), kThreads, 0, state.stream>>>(batch);
  VOXELPIPE_LAUNCHED_OR_RETURN("FillBatchValues");
  return absl::OkStatus();
}

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
  VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kQueued0}));
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
  SuffixXor<<<BlocksFor(state.slab_rows(), kThreads / 32), kThreads, 0, state.stream>>>(
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
    VOXELPIPE_OK_OR_RETURN(ClearCounters(state, {kQueued0}));
    VOXELPIPE_OK_OR_RETURN(sums.Fill(0, state.stream));
    VOXELPIPE_OK_OR_RETURN(outside.Fill(0, state.stream));
    args.queued = state.counters.data() + kQueued0;
    args.view.first_row = row;
    args.view.end_row = std::min(rows, row + at_once);
    VOXELPIPE_OK_OR_RETURN(Toggle(args, state.device, 8, state.stream));
    SpreadSums<<<BlocksFor(args.view.end_row - row, kThreads / 32), kThreads, 0, state.stream>>>(
        args.view, state.counters.data() + kOddColumns);
    VOXELPIPE_LAUNCHED_OR_RETURN("SpreadSums");
  }
  return absl::OkStatus();
}

absl::Status SolidFill(RunState& state) {
  const VoxelizeRequest& request = state.request.request;
  VOXELPIPE_OK_OR_RETURN(state.inside.Resize(state.slab_words(), state.stream));
  VOXELPIPE_OK_OR_RETURN(request.fill == Fill::kFlood     ? FloodInside(state)
                         : request.fill == Fill::kNonzero ? NonzeroInside(state)
                                                          : ParityInside(state));
  if (request.result == ResultKind::kSparse) return absl::OkStatus();  // the bricks are filled as they are made
  for (int t = 0; t < state.targets.count; ++t) {
    if (state.targets.at[t].format != VoxelFormat::kBit) VOXELPIPE_OK_OR_RETURN(FillTarget(state, t));
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
