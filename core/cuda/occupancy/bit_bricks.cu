// Kernels that clear the pool of bit bricks and copy its bricks to the grid; allocation of the pool.
#include <algorithm>

#include "cuda/occupancy/bit_bricks.h"

#include "cuda/device/device.h"
#include "cuda/device/kernel_list.h"
#include "cuda/device/launch.cuh"
#include "cuda/primitives/dependent_launch.cuh"
#include "cuda/run/run_state.h"
#include "cuda/traversal/bit_bricks.cuh"

namespace voxelpipe::cuda {
namespace {

constexpr int kThreads = 256;

// Clears the slot table of bricks, and the queues.
__global__ void __launch_bounds__(kThreads) ClearPool(const __grid_constant__ BitArgs args) {
  AllowNext();
  if (blockIdx.x == 0 && threadIdx.x < kBitQueues) args.queued[threadIdx.x] = 0;
  if (blockIdx.x == 0 && threadIdx.x == kBitQueues) *args.pool.asked = 0;
  const uint64_t me = uint64_t(blockIdx.x) * kThreads + threadIdx.x, threads = uint64_t(gridDim.x) * kThreads;
  for (uint64_t i = me; i < args.pool.quads; i += threads) {
    reinterpret_cast<uint4*>(args.pool.places)[i] = uint4{0, 0, 0, 0};
  }
}

constexpr int kPartThreads = 256, kPartWarps = kPartThreads / 32;

// One warp per tile, in launch order: with persistent blocks, warps would drift apart; memory writes of adjacent tiles
// are a third faster.
template <bool kQuads>
__global__ void __launch_bounds__(kPartThreads, 2048 / kPartThreads) StorePool(const __grid_constant__ BitArgs args) {
  __shared__ PartRoom rooms[kPartWarps];
  AllowNext();
  AwaitEarlier();
  if (!kQuads && blockIdx.x == 0) ClearBehind(args);
  const uint32_t warp = threadIdx.x / 32;
  const PoolPart part(args, blockIdx.x * kPartWarps + warp);
  if (int64_t{part.z} < args.grid.slab_end - args.grid.slab_begin) StorePart<kQuads>(args, part, rooms[warp]);
}

}  // namespace

bool MakeBitPool(RunState& state, BitArgs& args) {
  constexpr uint64_t kPartOfMemory = 32;
  const auto ny = uint64_t(args.grid.dims[1]);
  const auto nz = uint64_t(args.grid.slab_end - args.grid.slab_begin);
  BitPool& pool = args.pool;
  pool.dims_x = uint32_t(args.grid.words_per_row);
  pool.dims_y = uint32_t((ny + 7) / 8);
  const uint64_t bricks = uint64_t{pool.dims_x} * pool.dims_y * ((nz + 7) / 8), places = (bricks + 3) / 4 * 4;
  const uint64_t words = places + bricks * BitPool::kWordsOfPlace;
  const uint64_t most = std::min(state.device.memory_bytes, MemoryLimit()) / kPartOfMemory / sizeof(uint32_t);
  if (words > std::min<uint64_t>(most, UINT32_MAX) || !state.bit_pool.Resize(words, state.stream).ok()) return false;
  pool.places = state.bit_pool.data();
  pool.words = pool.places + places;
  pool.asked = state.counters.data() + kPooled;
  pool.quads = places / 4;
  return true;
}

void AddClearPool(const RunState& state, const BitArgs& args, LaunchList& list) {
  list.Add("ClearPool", Begins::kBehind, BlocksFor(args.pool.quads, kThreads, uint64_t(state.device.multiprocessors)),
           kThreads, ClearPool, args);
}

void AddStorePool(const RunState& state, const BitArgs& args, LaunchList& list) {
  const auto blocks = unsigned((PartsOf(args) + kPartWarps - 1) / kPartWarps);
  list.Add("StorePool", EarlyIfAble(state.device), blocks, kPartThreads,
           args.grid.words_per_row % 4 == 0 ? StorePool<true> : StorePool<false>, args);
}

}  // namespace voxelpipe::cuda
