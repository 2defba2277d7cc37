#include "cuda/triangle_order.h"

#include "cuda/device_abilities.h"
#include "cuda/early_launch.cuh"
#include "cuda/launch.h"

namespace voxelpipe::cuda {
namespace {

constexpr uint32_t kCells = kOrderCells + 2;  // with what stands behind them: OrderArgs

__global__ void __launch_bounds__(kOrderThreads)
    BeginOrder(const __grid_constant__ BitArgs args, const __grid_constant__ OrderArgs order) {
  AllowNext();
  const uint32_t i = blockIdx.x * kOrderThreads + threadIdx.x;
  if (i < kCells) order.cells[i] = 0;
  if (i < kBitQueues) args.queued[i] = 0;
}

template <bool kPacked>
__global__ void __launch_bounds__(kOrderThreads)
    OrderKeys(const __grid_constant__ BitArgs args, const __grid_constant__ OrderArgs order) {
  __shared__ OrderRoom room;
  AllowNext();
  KeyTriangles<kPacked>(args, order, room);
}

__global__ void __launch_bounds__(kOrderThreads)
    OrderPlaces(const __grid_constant__ BitArgs args, const __grid_constant__ OrderArgs order) {
  __shared__ OrderRoom room;
  PlaceTriangles(args, order, room);
}

}  // namespace

bool CanOrder(const BitArgs& args) {
  return args.fixed.bits > 0 && args.coverage != Coverage::kCenter;
}

bool MakeRoomForOrder(RunState& state, const BitArgs& args, OrderArgs& order) {
  if (!CanOrder(args)) return false;
  if (!state.order.Resize(kCells + args.triangle_count, state.stream).ok()) return false;
  order.cells = state.order.data();
  order.order = order.cells + kCells;
  order.keys = args.layer_queue;  // nothing waits there yet
  const int64_t dims[3] = {args.grid.dims[0], args.grid.dims[1], args.grid.slab_end - args.grid.slab_begin};
  for (int a = 0; a < 3; ++a) {
    while (dims[a] > int64_t{kCellsOfSide} << order.shift[a]) ++order.shift[a];
  }
  return true;
}

TriangleOrder OrderOf(const RunState& state) {
  return {state.order.data() + kCells, state.order.data() + kOrderCells};
}

absl::Status OrderTriangles(RunState& state, const BitArgs& args, const OrderArgs& order) {
  BeginOrder<<<(kCells + kOrderThreads - 1) / kOrderThreads, kOrderThreads, 0, state.stream>>>(args, order);
  VOXELPIPE_LAUNCHED_OR_RETURN("BeginOrder");
  const bool early = BeginsEarly(state.device);
  const auto chunks = unsigned((args.triangle_count + kOrderChunk - 1) / kOrderChunk);
  LaunchEarly(early, state.stream, chunks, kOrderThreads, args.packed != nullptr ? OrderKeys<true> : OrderKeys<false>,
              args, order);
  VOXELPIPE_LAUNCHED_OR_RETURN("OrderKeys");
  LaunchEarly(early, state.stream, chunks, kOrderThreads, OrderPlaces, args, order);
  VOXELPIPE_LAUNCHED_OR_RETURN("OrderPlaces");
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
