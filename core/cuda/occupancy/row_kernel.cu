// The kernel that rasterizes all triangles by rows, and the decision when to use it.
#include "cuda/occupancy/row_kernel.h"

#include <algorithm>
#include <cmath>

#include "cuda/device/kernel_list.h"
#include "cuda/occupancy/row_kernel.cuh"
#include "cuda/primitives/dependent_launch.cuh"

namespace voxelpipe::cuda {
namespace {

constexpr int kRowBlocks = 8;  // resident blocks of RowKernel per multiprocessor
// RowKernel is used if more than 1/kMinShare of the triangles need rows: with 28 % it is 8 % faster than CellKernel,
// with 18 % 15 % slower.
constexpr uint64_t kMinShare = 4;

template <bool kThin, bool kPacked, bool kTogether>
__global__ void __launch_bounds__(kCellThreads, kRowBlocks) RowKernel(const __grid_constant__ BitArgs args) {
  __shared__ RowRoom<kTogether> room;
  AllowNext();
  WalkByRows<kThin, kPacked, kTogether>(args, uint64_t(blockIdx.x) * kCellThreads + threadIdx.x, room);
}

template <bool kThin>
auto* KernelFor(const BitArgs& args, bool together) {
  if (args.packed != nullptr) return RowKernel<kThin, true, false>;
  return together ? RowKernel<kThin, false, true> : RowKernel<kThin, false, false>;
}

// The maximum extent of a triangle along an axis in voxels, minus 1.
double VoxelsOf(const TriangleMesh& mesh, uint64_t t, const GridSpec& grid) {
  double most = 0;
  for (int a = 0; a < 3; ++a) {
    double lo = HUGE_VAL, hi = -HUGE_VAL;
    for (const uint32_t v : mesh.triangles[t]) {
      const double at = std::floor((mesh.positions[v][a] - grid.origin[a]) / grid.voxel_size[a]);
      lo = std::min(lo, at);
      hi = std::max(hi, at);
    }
    most = std::max(most, hi - lo);
  }
  return most;
}

}  // namespace

bool ManyGoByRows(RunState& state) {
  if (state.by_rows) return *state.by_rows;
  constexpr uint64_t kSamples = 128;
  const TriangleMesh& mesh = state.host.mesh;
  const uint64_t count = state.mesh.host_view.triangle_count;
  uint64_t samples = 0, by_rows = 0;
  if (mesh.triangles.size() == count && count > 0) {
    for (uint64_t t = 0; t < count; t += (count + kSamples - 1) / kSamples) {
      const double voxels = VoxelsOf(mesh, t, state.grid);
      by_rows += voxels >= 2 && voxels < kMaxCells ? 1 : 0;
      ++samples;
    }
  }
  state.by_rows = by_rows * kMinShare > samples;
  return *state.by_rows;
}

void AddRows(const RunState& state, const BitArgs& args, bool together, LaunchList& list) {
  auto* const kernel =
      args.coverage == Coverage::kThin ? KernelFor<true>(args, together) : KernelFor<false>(args, together);
  list.Add("RowKernel", EarlyIfAble(state.device), unsigned((args.triangle_count + kCellThreads - 1) / kCellThreads),
           kCellThreads, kernel, args);
}

}  // namespace voxelpipe::cuda
