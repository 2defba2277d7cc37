// Plain bits: rows of voxels set straight in the bit grid, without tiles. Atomic ORs set words; full words between them are stored.
#include <algorithm>
#include <cstdint>

#include "cuda/walk.h"
#include "grid/index_space.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;

template <bool kLookFirst>
struct SetBits {
  GridView grid;  // with the slab that `bits` is of
  uint32_t* bits;

  __device__ static bool repeats() { return false; }
  __device__ void Begin(uint32_t) const {}
  __device__ void End(uint32_t) const {}
  __device__ void Finish() const {}
  __device__ void Row(int y, int z, int x_begin, int x_end) const {
    uint32_t* const row = bits + grid.Word(0, y, z);
    const int first = x_begin / 32, last = (x_end - 1) / 32;
    const uint32_t from = ~0u << (x_begin % 32), upto = ~0u >> (31 - (x_end - 1) % 32);
    if (first == last) return Set(row + first, from & upto);
    Set(row + first, from);
    for (int w = first + 1; w < last; ++w) row[w] = ~0u;
    Set(row + last, upto);
  }
  __device__ void SharedRow(uint32_t, int y, int z, int x_begin, int x_end) const { Row(y, z, x_begin, x_end); }

  // Where many triangles share a voxel most bits are set already, and reading is cheaper than an atomic.
  __device__ static void Set(uint32_t* word, uint32_t mask) {
    if (kLookFirst && (__ldca(word) & mask) == mask) return;
    atomicOr(word, mask);
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

}  // namespace

absl::Status RasterRows(RunState& state, Coverage coverage, int64_t z_begin, int64_t z_end, uint32_t* bits,
                        uint64_t words) {
  VOXELPIPE_OK_OR_RETURN(EnsureCounters(state));
  const uint64_t quads = (words + 3) / 4;  // a DeviceArray ends on a whole one
  const uint64_t place = state.placed ? 0 : state.mesh.host_view.vertex_count;
  const uint64_t blocks = std::clamp<uint64_t>((std::max(quads / 4, place) + kThreads - 1) / kThreads, 1,
                                               uint64_t(state.device.multiprocessors) * 16);
  Prepare<<<unsigned(blocks), kThreads, 0, state.stream>>>(
      reinterpret_cast<uint4*>(bits), quads, state.counters.data(), state.mesh.positions.data(), place,
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
