// Launches the kernels of bit_order.cuh. Included by .cu files only.
#pragma once

#include "cuda/bit_order.cuh"
#include "cuda/run_state.h"

namespace voxelpipe::cuda {

// Whether fixed point tells the triangles their places.
bool CanOrder(const BitArgs& args);
// Room for the order of triangles, and what else of `order` does not depend on them. False where there is none, or they cannot be ordered.
bool MakeRoomForOrder(RunState& state, const BitArgs& args, OrderArgs& order);
// The order that was made last: the numbers of triangles, and how many there are.
struct TriangleOrder {
  const uint32_t *order, *count;
};
TriangleOrder OrderOf(const RunState& state);
// Orders the triangles, and lists the largest in the large queue; clears the queues before.
absl::Status OrderTriangles(RunState& state, const BitArgs& args, const OrderArgs& order);

}  // namespace voxelpipe::cuda
