// Kernels for occupancy bits of one grid: distribute the work of small_triangles.cuh, resident_mesh.cuh,
// large_triangles.cuh, block_bins.cuh and block_raster.cuh over blocks. occupancy.cu selects them; RowKernel is in
// row_kernel.cu. No host-only includes.
#pragma once

#include "cuda/occupancy/block_bins.cuh"
#include "cuda/occupancy/block_raster.cuh"
#include "cuda/occupancy/large_triangles.cuh"
#include "cuda/occupancy/resident_mesh.cuh"
#include "cuda/primitives/acquire_release.cuh"
#include "cuda/primitives/dependent_launch.cuh"
#include "cuda/traversal/small_triangles.cuh"

namespace voxelpipe::cuda {

inline constexpr int kClearThreads = 256;
inline constexpr int kCellBlocks = 8;  // resident blocks of CellKernel or FewKernel per multiprocessor

// Clears 16-byte units, with all threads of the first `blocks` blocks of the grid.
__device__ inline void ClearQuads(uint32_t* words, uint64_t begin, uint64_t end, uint32_t blocks) {
  const uint64_t me = uint64_t(blockIdx.x) * blockDim.x + threadIdx.x, threads = uint64_t(blocks) * blockDim.x;
  for (uint64_t i = begin + me; i < end; i += threads) reinterpret_cast<uint4*>(words)[i] = uint4{0, 0, 0, 0};
}

// Clears the bits and the queues in the same way.
__device__ inline void Clear(const BitArgs& args, uint32_t blocks) {
  if (blockIdx.x == 0 && threadIdx.x < kBitQueues) args.queued[threadIdx.x] = 0;
  ClearQuads(args.bits, 0, args.quads, blocks);
}

__global__ void __launch_bounds__(kClearThreads) ClearKernel(const __grid_constant__ BitArgs args) {
  AllowNext();
  Clear(args, gridDim.x);
}

// Clears the queues, the bin counters, and the layers of grid blocks that are not stored. It overlaps BinKernel, whose
// triangle setup leaves memory idle.
__global__ void __launch_bounds__(kClearThreads)
    ClearForBins(const __grid_constant__ BitArgs args, const __grid_constant__ Bins bins) {
  AllowNext();
  if (blockIdx.x == 0 && threadIdx.x < kBitQueues) args.queued[threadIdx.x] = 0;
  const uint32_t all = gridDim.x;
  ClearQuads(bins.counts, 0, uint64_t(bins.triangles - bins.counts) / 4, all);
  const uint64_t layer = uint64_t(args.grid.words_per_row) * uint64_t(args.grid.dims[1]) * kPieceEdge / 4;
  ClearQuads(args.bits, 0, bins.z_begin * layer, all);
  ClearQuads(args.bits, min(bins.z_end * layer, args.quads), args.quads, all);
}

// The first blocks of a kernel may clear the grid, which saves a launch. Blocks start in the order of their numbers, so
// the blocks that others wait for are running; CUDA does not guarantee this, but CUB's scans rely on it too. True if
// this block clears.
__device__ inline bool ClearsFirst(const BitArgs& args) {
  if (blockIdx.x >= args.clear_blocks) return false;
  Clear(args, args.clear_blocks);
  __syncthreads();
  if (threadIdx.x == 0) AddRelease(args.cleared, 1);
  return true;
}

template <bool kThin, bool kPacked, BitSink kSink>
__global__ void __launch_bounds__(kCellThreads, kCellBlocks) CellKernel(const __grid_constant__ BitArgs args) {
  __shared__ CellRoomFor<kSink> room;
  AllowNext();
  if (ClearsFirst(args)) return;
  WalkCells<kThin, kPacked, kSink>(args, blockIdx.x - args.clear_blocks, room);
}

template <bool kThin, int kRowLanes>
__global__ void __launch_bounds__(kCellThreads, kCellBlocks) FewKernel(const __grid_constant__ BitArgs args) {
  __shared__ FewRoom<kRowLanes> room;
  AllowNext();
  if (ClearsFirst(args)) return;
  WalkFew<kThin, kRowLanes>(args, blockIdx.x - args.clear_blocks, room);
}

inline constexpr int kLayerThreads = kLargeThreads, kLayerSetups = 16, kLayerBlocks = 4;

union LayerRoom {
  SharedSetup of_warps[kLayerThreads / 32][kLayerSetups];
  LargeRoom large;
};

__global__ void __launch_bounds__(kLayerThreads, kLayerBlocks) LayerKernel(const __grid_constant__ BitArgs args) {
  __shared__ alignas(16) char memory[sizeof(LayerRoom)];
  auto& room = *reinterpret_cast<LayerRoom*>(memory);
  const uint32_t warp = threadIdx.x / 32, warps = kLayerThreads / 32;
  AwaitEarlier();
  if (args.clear_blocks > 0 && blockIdx.x == 0 && threadIdx.x == 0) StoreRelaxed(args.cleared, 0);
  // Loads both counts at once: often both are 0, and the latency matters for a small mesh.
  const uint64_t large = __ldcg(args.queued + kLargeQueue), layers = __ldcg(args.queued + kLayerQueue);
  WalkLarge(args, large, blockIdx.x, gridDim.x, room.large);
  WalkLayers<kLayerSetups>(args, layers, uint64_t(blockIdx.x) * warps + warp, uint64_t(gridDim.x) * warps,
                           room.of_warps[warp]);
}

// Sets up args.largest for a StoreKernel, and clears the queues.
__global__ void __launch_bounds__(32) SetUpLargestKernel(const __grid_constant__ BitArgs args, SharedSetup* setups) {
  AllowNext();
  if (blockIdx.x == 0 && threadIdx.x < kBitQueues) args.queued[threadIdx.x] = 0;
  const uint32_t place = blockIdx.x * kMaxInParts + threadIdx.x / kBoundsParts;
  const uint32_t part = threadIdx.x % kBoundsParts;
  const bool has = place < args.largest->listed();
  Vec3d mine{};
  if (place < kMaxApart && part < 3) mine = PlacePosition(args, args.largest->corners[place][part]);
  __syncwarp();
  SharedSetup& s = setups[has ? place : 0];
  const uint64_t rows = SetUpPlacedInParts(args, has, has ? args.largest->triangles[place] : 0, mine, s);
  if (has && rows == 0 && part == 0) s.begin[2] = s.end[2] = 0;
}

// Grid barrier for a cooperative launch. The counter is 0 except for its highest bit before and after.
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

inline constexpr int kBinBlocks = 8;          // resident blocks per multiprocessor
inline constexpr int kStoreThreads = 1024;    // resident threads per multiprocessor
inline constexpr uint32_t kStoreDepth = 128;  // blocks along z

template <bool kFew>
__global__ void __launch_bounds__(kBinThreads, kBinBlocks)
    BinKernel(const __grid_constant__ BitArgs args, const __grid_constant__ Bins bins) {
  constexpr uint32_t kWarps = kBinThreads / 32;
  // No early start of the next kernel: its blocks would take resources of these.
  __shared__ alignas(16) char memory[kBinThreads * sizeof(SharedSetup)];
  FillBins<kFew>(args, bins, uint64_t(blockIdx.x) * kWarps + threadIdx.x / 32, uint64_t(gridDim.x) * kWarps,
                 reinterpret_cast<SharedSetup*>(memory) + threadIdx.x / 32 * 32);
}

template <bool kQuads, bool kListed, int kThreads>
__global__ void __launch_bounds__(kThreads, kStoreThreads / kThreads)
    StoreKernel(const __grid_constant__ BitArgs args, const __grid_constant__ Bins bins) {
  using Room = StoreRoomFor<kListed, kThreads>;
  __shared__ alignas(16) char memory[sizeof(Room)];
  AllowNext();
  AwaitEarlier();
  StorePieces<kQuads, kListed, kThreads>(args, bins, *reinterpret_cast<Room*>(memory));
}

inline constexpr int kAtOnceThreads = kLargeThreads, kAtOnceSetups = 8, kAtOnceBlocks = 4;

union AtOnceRoom {
  SharedSetup of_warps[kAtOnceThreads / 32][kAtOnceSetups];
  LargeRoom large;
};

// All steps in one cooperative launch, for meshes with at most kAtOnceSetups triangles per warp, where latency
// dominates. Triangles are set up while the bits are cleared.
__global__ void __launch_bounds__(kAtOnceThreads, kAtOnceBlocks)
    AtOnceKernel(const __grid_constant__ BitArgs args, unsigned* arrived) {
  __shared__ alignas(16) char memory[sizeof(AtOnceRoom)];
  auto& room = *reinterpret_cast<AtOnceRoom*>(memory);
  // Distributes neighbours in the mesh over multiprocessors.
  const uint64_t warps = uint64_t(gridDim.x) * (kAtOnceThreads / 32);
  const uint64_t warp = uint64_t(threadIdx.x / 32) * gridDim.x + blockIdx.x;
  const uint64_t each = (args.triangle_count + warps - 1) / warps, lane = threadIdx.x % 32;
  SharedSetup* const shared = room.of_warps[threadIdx.x / 32];
  Clear(args, gridDim.x);
  const uint64_t begin = min(warp * each, args.triangle_count);
  static_assert(kAtOnceSetups <= int(kMaxInParts));
  const uint64_t rows = SetUpFew(
      args, uint32_t(min(each, args.triangle_count - begin)), [begin](uint32_t i) { return uint32_t(begin) + i; },
      shared);
  WaitForGrid(arrived);
  uint32_t layers = 0;
  if (rows > 0) {
    layers = LayersOf(shared[lane]);
    const int width = shared[lane].end[1] - shared[lane].begin[1];
    if (QueueOf(width, layers) == CellFate::kLarge) {
      layers = 0;
      args.large_queue[atomicAdd(reinterpret_cast<unsigned long long*>(args.queued + kLargeQueue), 1ull)] =
          uint32_t(begin + lane);
    }
  }
  WalkSetUp<kAtOnceSetups>(args, shared, layers);
  WaitForGrid(arrived);
  WalkLarge(args, __ldcg(args.queued + kLargeQueue), blockIdx.x, gridDim.x, room.large);
}

}  // namespace voxelpipe::cuda
