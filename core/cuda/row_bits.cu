// Plain bits: rows of voxels set straight in the bit grid, without tiles. Atomic ORs set words; full words between them are stored.
#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>

#include "cuda/batch.h"
#include "cuda/batch_kernel.cuh"
#include "cuda/bit_walk.cuh"
#include "cuda/launch.h"
#include "cuda/walk.h"
#include "grid/index_space.h"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;
constexpr int kCellBlocks = 4;  // of CellKernel on a multiprocessor at once

// Sets bits in the grids of a batch.
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

// Clears the bits and the queues.
__device__ inline void Clear(const BitArgs& args) {
  const uint64_t me = uint64_t(blockIdx.x) * blockDim.x + threadIdx.x, threads = uint64_t(gridDim.x) * blockDim.x;
  if (me < kBitQueues) args.queued[me] = 0;
  for (uint64_t i = me; i < args.quads; i += threads) reinterpret_cast<uint4*>(args.bits)[i] = uint4{0, 0, 0, 0};
}

__global__ void __launch_bounds__(kThreads) ClearKernel(const __grid_constant__ BitArgs args) {
  Clear(args);
}

template <bool kThin>
__global__ void __launch_bounds__(kCellThreads, kCellBlocks) CellKernel(const __grid_constant__ BitArgs args) {
  __shared__ CellRoom room;
  WalkCells<kThin>(args, blockIdx.x, room);
}

constexpr int kLayerThreads = 128, kLayerSetups = 8;

union LayerRoom {
  SharedSetup of_warps[kLayerThreads / 32][kLayerSetups];
  LargeRoom large;
};

__global__ void __launch_bounds__(kLayerThreads, 4) LayerKernel(const __grid_constant__ BitArgs args) {
  __shared__ alignas(16) char memory[sizeof(LayerRoom)];
  auto& room = *reinterpret_cast<LayerRoom*>(memory);
  WalkLarge(args, blockIdx.x, gridDim.x, room.large);
  const uint32_t warp = threadIdx.x / 32, warps = kLayerThreads / 32;
  WalkLayers<kLayerSetups>(args, uint64_t(blockIdx.x) * warps + warp, uint64_t(gridDim.x) * warps, room.of_warps[warp]);
}

// Waits for all blocks of a cooperative launch. The counter is 0 but for its highest bit, and so it is left.
__device__ inline void WaitForGrid(unsigned* arrived) {
  __syncthreads();
  if (threadIdx.x == 0) {
    __threadfence();
    const unsigned mine = blockIdx.x == 0 ? 0x80000000u - (gridDim.x - 1) : 1u;
    const unsigned before = atomicAdd(arrived, mine);
    while (((before ^ *const_cast<volatile unsigned*>(arrived)) & 0x80000000u) == 0) {}
    __threadfence();
  }
  __syncthreads();
}

// All steps in one launch, for meshes that take no longer than launches do.
template <bool kThin>
__global__ void __launch_bounds__(kCellThreads, 2)
    AtOnceKernel(const __grid_constant__ BitArgs args, unsigned* arrived) {
  constexpr size_t kBytes = kCellThreads / 32 * kLayerSetups * sizeof(SharedSetup);
  __shared__ alignas(16) char memory[sizeof(CellRoom)];
  static_assert(sizeof(CellRoom) >= kBytes && sizeof(CellRoom) >= sizeof(LargeRoom));
  Clear(args);
  WaitForGrid(arrived);
  const uint64_t chunks = (args.triangle_count + uint64_t(args.per_block) - 1) / uint64_t(args.per_block);
  for (uint64_t chunk = blockIdx.x; chunk < chunks; chunk += gridDim.x) {
    WalkCells<kThin>(args, chunk, *reinterpret_cast<CellRoom*>(memory));
  }
  WaitForGrid(arrived);
  const uint64_t threads = uint64_t(gridDim.x) * kCellThreads;
  // Neighbours in the queue to different multiprocessors: there may be few.
  const uint64_t warp = uint64_t(threadIdx.x / 32) * gridDim.x + blockIdx.x;
  WalkLarge(args, blockIdx.x, gridDim.x, *reinterpret_cast<LargeRoom*>(memory));
  WalkLayers<kLayerSetups>(args, warp, threads / 32,
                           reinterpret_cast<SharedSetup*>(memory) + threadIdx.x / 32 * kLayerSetups);
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

namespace {

// Up to so many triangles all is one launch.
constexpr uint64_t kMostAtOnce = 20'000;

// Blocks of AtOnceKernel that the device runs at once; 0 where they cannot wait for each other.
template <bool kThin>
int BlocksAtOnce(const DeviceInfo& device) {
  static std::array<std::atomic<int>, 64> known{};  // per device: one more than found
  const size_t slot = size_t(device.ordinal) % known.size();
  if (const int found = known[slot].load(std::memory_order_relaxed); found > 0) return found - 1;
  int cooperative = 0, resident = 0;
  if (cudaDeviceGetAttribute(&cooperative, cudaDevAttrCooperativeLaunch, device.ordinal) != cudaSuccess ||
      cooperative == 0 ||
      cudaOccupancyMaxActiveBlocksPerMultiprocessor(&resident, AtOnceKernel<kThin>, kCellThreads, 0) != cudaSuccess) {
    (void)cudaGetLastError();
    resident = 0;
  }
  const int blocks = std::min(resident, 2) * device.multiprocessors;
  known[slot].store(blocks + 1, std::memory_order_relaxed);
  return blocks;
}

template <bool kThin>
absl::Status LaunchAtOnce(RunState& state, BitArgs& args, int blocks) {
  auto* arrived = reinterpret_cast<unsigned*>(state.counters.data() + kQueued3);
  void* arguments[] = {&args, &arrived};
  VOXELPIPE_CUDA_OR_RETURN(cudaLaunchCooperativeKernel(reinterpret_cast<const void*>(&AtOnceKernel<kThin>),
                                                       dim3(unsigned(blocks)), dim3(kCellThreads), arguments, 0,
                                                       state.stream));
  VOXELPIPE_LAUNCHED_OR_RETURN("AtOnceKernel");
  return absl::OkStatus();
}

absl::Status LaunchSteps(const RunState& state, const BitArgs& args, bool thin) {
  const auto processors = unsigned(state.device.multiprocessors);
  ClearKernel<<<BlocksFor(args.quads / 4, kThreads, processors * 16), kThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("ClearKernel");
  if (args.triangle_count == 0) return absl::OkStatus();
  const auto blocks = unsigned((args.triangle_count + uint64_t(args.rounds) * kCellThreads - 1) /
                               (uint64_t(args.rounds) * kCellThreads));
  if (thin) {
    CellKernel<true><<<blocks, kCellThreads, 0, state.stream>>>(args);
  } else {
    CellKernel<false><<<blocks, kCellThreads, 0, state.stream>>>(args);
  }
  VOXELPIPE_LAUNCHED_OR_RETURN("CellKernel");
  LayerKernel<<<processors * 4, kLayerThreads, 0, state.stream>>>(args);
  VOXELPIPE_LAUNCHED_OR_RETURN("LayerKernel");
  return absl::OkStatus();
}

}  // namespace

absl::Status RasterRows(RunState& state, Coverage coverage, int64_t z_begin, int64_t z_end, uint32_t* bits,
                        uint64_t words) {
  VOXELPIPE_OK_OR_RETURN(EnsureCounters(state));
  const MeshView& mesh = state.mesh.host_view;
  for (int i = 0; i < kBitQueues; ++i) {
    VOXELPIPE_OK_OR_RETURN(state.queue[i].Resize(std::max<uint64_t>(mesh.triangle_count, 1), state.stream));
  }
  BitArgs args;
  args.grid = state.view;
  args.grid.slab_begin = z_begin;
  args.grid.slab_end = z_end;
  args.bits = bits;
  args.quads = (words + 3) / 4;  // a DeviceArray ends on a whole one
  args.coverage = coverage;
  const Vec3d &origin = state.grid.origin, &size = state.grid.voxel_size;
  if (mesh.triangle_count > 0) {
    args.fixed = MakeFixedPlace(origin, size, WorldToIndex(origin, size, state.box.min),
                                WorldToIndex(origin, size, state.box.max));
  }
  args.inverse_size = {1 / size.x, 1 / size.y, 1 / size.z};
  args.triangles = state.mesh.triangle_list();
  args.positions = mesh.positions;
  args.triangle_count = mesh.triangle_count;
  args.layer_queue = state.queue[0].data();
  args.large_queue = state.queue[1].data();
  args.queued = state.counters.data() + kQueued0;
  const bool thin = coverage == Coverage::kThin;
  // The last counter of the queues is the barrier's: runs of plain bits put it to no other use.
  if (state.plain_bits && args.triangle_count > 0 && args.triangle_count <= kMostAtOnce) {
    const int blocks = thin ? BlocksAtOnce<true>(state.device) : BlocksAtOnce<false>(state.device);
    args.per_block = int(
        std::clamp<uint64_t>((args.triangle_count / uint64_t(std::max(blocks, 1)) + 31) / 32 * 32, 32, kCellThreads));
    if (blocks > 0) return thin ? LaunchAtOnce<true>(state, args, blocks) : LaunchAtOnce<false>(state, args, blocks);
  }
  args.per_block = kCellThreads;
  // As many rounds as leave the least to the last wave of blocks.
  const uint64_t resident = uint64_t(state.device.multiprocessors) * kCellBlocks;
  uint64_t least = UINT64_MAX;
  for (int rounds = kMostCellRounds; rounds >= 1; --rounds) {
    const uint64_t blocks =
        (args.triangle_count + uint64_t(rounds) * kCellThreads - 1) / (uint64_t(rounds) * kCellThreads);
    const uint64_t waves = (blocks + resident - 1) / resident, work = 4 * waves * uint64_t(rounds) + waves;
    if (work < least) {
      least = work;
      args.rounds = rounds;
    }
  }
  return LaunchSteps(state, args, thin);
}

}  // namespace voxelpipe::cuda
