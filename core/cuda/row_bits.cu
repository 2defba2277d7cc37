// Plain bits: rows of voxels set straight in the bit grid, without tiles. Atomic ORs set words; full words between them are stored.
#include <algorithm>
#include <cstdint>

#include "cuda/batch.h"
#include "cuda/batch_kernel.cuh"
#include "cuda/launch.h"
#include "cuda/walk.h"
#include "grid/index_space.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;

// Sets voxels [x_begin, x_end) of a row. Where many triangles share a voxel most bits are set already, and reading first (`look`) is
// cheaper than an atomic.
__device__ inline void SetWord(uint32_t* word, uint32_t mask, bool look) {
  if (look && (__ldca(word) & mask) == mask) return;
  atomicOr(word, mask);
}
__device__ inline void SetRow(uint32_t* row, int x_begin, int x_end, bool look) {
  const int first = x_begin / 32, last = (x_end - 1) / 32;
  const uint32_t from = ~0u << (x_begin % 32), upto = ~0u >> (31 - (x_end - 1) % 32);
  if (first == last) return SetWord(row + first, from & upto, look);
  SetWord(row + first, from, look);
  for (int w = first + 1; w < last; ++w) row[w] = ~0u;
  SetWord(row + last, upto, look);
}

template <bool kLookFirst>
struct SetBits {
  GridView grid;  // with the slab that `bits` is of
  uint32_t* bits;

  __device__ static bool repeats() { return false; }
  __device__ void Begin(uint32_t) const {}
  __device__ void End(uint32_t) const {}
  __device__ void Finish() const {}
  __device__ void Row(int y, int z, int x_begin, int x_end) const {
    SetRow(bits + grid.Word(0, y, z), x_begin, x_end, kLookFirst);
  }
  __device__ void SharedRow(uint32_t, int y, int z, int x_begin, int x_end) const { Row(y, z, x_begin, x_end); }
};

// The same in the grids of a batch.
struct SetBatchBits {
  BatchView batch;
  const BatchItemView* item = nullptr;

  __device__ static bool repeats() { return false; }
  __device__ void Begin(uint32_t t) { item = batch.items + batch.item_of[t]; }
  __device__ void End(uint32_t) const {}
  __device__ void Finish() const {}
  __device__ void Row(int y, int z, int x_begin, int x_end) const { Set(*item, y, z, x_begin, x_end); }
  __device__ void SharedRow(uint32_t t, int y, int z, int x_begin, int x_end) const {
    Set(batch.items[batch.item_of[t]], y, z, x_begin, x_end);
  }

 private:
  __device__ void Set(const BatchItemView& of, int y, int z, int x_begin, int x_end) const {
    SetRow(batch.bits + of.first_word + of.grid.Word(0, y, z), x_begin, x_end, of.look_first);
  }
};

// Clears the bits and, where asked for, takes the vertices to index space.
__global__ void __launch_bounds__(kThreads)
    Prepare(uint4* bits, uint64_t quads, uint64_t* counters, const Vec3d* world, uint64_t vertices, Vec3d origin,
            Vec3d voxel_size, Vec3d* placed, VertexCode* codes) {
  const uint64_t me = uint64_t(blockIdx.x) * kThreads + threadIdx.x, threads = uint64_t(gridDim.x) * kThreads;
  if (me < 4) counters[kQueued0 + me] = 0;
  for (uint64_t i = me; i < quads; i += threads) bits[i] = uint4{0, 0, 0, 0};
  for (uint64_t i = me; i < vertices; i += threads) {
    const Vec3d p = WorldToIndex(origin, voxel_size, world[i]);
    placed[i] = p;
    codes[i] = EncodeVertex(p);
  }
}

// A batch's beginning: clears its bits and counters, takes its vertices to the index space of their grids, and tells each triangle its
// item and its vertices among all.
__global__ void __launch_bounds__(kThreads) PrepareBatch(const __grid_constant__ BatchView batch) {
  const uint64_t me = uint64_t(blockIdx.x) * kThreads + threadIdx.x, threads = uint64_t(gridDim.x) * kThreads;
  for (uint64_t i = me; i < batch.zero_quads; i += threads) static_cast<uint4*>(batch.zero)[i] = uint4{0, 0, 0, 0};
  for (uint64_t i = me; i < batch.vertex_count; i += threads) {
    const BatchItemView& item = batch.items[ItemAt(batch, &BatchItemView::first_vertex, i)];
    const Vec3d p = WorldToIndex(item.grid.origin, item.grid.voxel_size, item.positions[i - item.first_vertex]);
    batch.placed[i] = p;
    batch.codes[i] = EncodeVertex(p);
  }
  for (uint64_t i = me; i < batch.triangle_count; i += threads) {
    const uint32_t number = ItemAt(batch, &BatchItemView::first_triangle, i);
    const BatchItemView& item = batch.items[number];
    batch.item_of[i] = number;
    const uint32_t* const from = item.triangles + 3 * (i - item.first_triangle);
    for (int c = 0; c < 3; ++c) batch.triangles[3 * i + uint64_t(c)] = from[c] + uint32_t(item.first_vertex);
  }
}

}  // namespace

absl::Status RasterBatch(const BatchState& state) {
  const BatchView& batch = state.view;
  const uint64_t work = std::max({batch.zero_quads / 4, batch.vertex_count, batch.triangle_count});
  PrepareBatch<<<BlocksFor(work, kThreads, uint64_t(state.device.multiprocessors) * 16), kThreads, 0, state.stream>>>(
      batch);
  VOXELPIPE_LAUNCHED_OR_RETURN("PrepareBatch");
  BatchWalkArgs args;
  args.items = batch.items;
  args.item_of = batch.item_of;
  args.triangles = batch.triangles;
  args.positions = batch.placed;
  args.codes = batch.codes;
  args.triangle_count = batch.triangle_count;
  args.small_queue = batch.queue[0];
  args.rest_queue = batch.queue[1];
  args.large_queue = batch.queue[2];
  args.queued = batch.queued;
  return WalkOn(state.device, state.stream, args, SetBatchBits{batch});
}

absl::Status RasterRows(RunState& state, Coverage coverage, int64_t z_begin, int64_t z_end, uint32_t* bits,
                        uint64_t words) {
  VOXELPIPE_OK_OR_RETURN(EnsureCounters(state));
  const uint64_t quads = (words + 3) / 4;  // a DeviceArray ends on a whole one
  const uint64_t place = state.placed ? 0 : state.mesh.host_view.vertex_count;
  const uint64_t blocks = std::clamp<uint64_t>((std::max(quads / 4, place) + kThreads - 1) / kThreads, 1,
                                               uint64_t(state.device.multiprocessors) * 16);
  Prepare<<<unsigned(blocks), kThreads, 0, state.stream>>>(
      reinterpret_cast<uint4*>(bits), quads, state.counters.data(), state.mesh.host_view.positions, place,
      state.grid.origin, state.grid.voxel_size, state.mesh.index_positions.data(), state.mesh.codes.data());
  VOXELPIPE_LAUNCHED_OR_RETURN("Prepare");
  state.placed = true;
  absl::StatusOr<WalkArgs> args = MakeWalkArgs(state);
  if (!args.ok()) return args.status();
  args->coverage = coverage;
  args->grid.slab_begin = z_begin;
  args->grid.slab_end = z_end;
  const int64_t* const d = state.view.dims;
  const double surface = double(d[0]) * double(d[1]) + double(d[1]) * double(d[2]) + double(d[2]) * double(d[0]);
  if (double(args->triangle_count) > 16 * surface) return Walk(state, *args, SetBits<true>{args->grid, bits});
  return Walk(state, *args, SetBits<false>{args->grid, bits});
}

}  // namespace voxelpipe::cuda
