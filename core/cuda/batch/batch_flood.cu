// Flood fill of a batch: the algorithm of flood_fill.cu with one block per item, so that no item waits for the host or
// for another item's sweeps.
#include "cuda/batch/batch_flood.cuh"

#include "cuda/batch/batch.h"
#include "cuda/device/launch.cuh"
#include "cuda/traversal/triangle_walk.h"

namespace voxelpipe::cuda {

absl::Status FloodBatch(const BatchState& state) {
  const BatchView& batch = state.view;
  if (batch.flood_count == 0) return absl::OkStatus();
  const ShellWalkArgs args{WalkOf(batch, batch.first_shell_triangle, batch.shell_triangles, kBatchShells)};
  VOXELPIPE_OK_OR_RETURN(
      WalkOn(state.device, state.stream, args, SetBatchBits<&BatchItemView::first_shell>(args, batch.shells)));
  FloodKernel<<<batch.flood_count, kFloodThreads, 0, state.stream>>>(batch);
  VOXELPIPE_LAUNCHED_OR_RETURN("FloodKernel");
  return absl::OkStatus();
}

}  // namespace voxelpipe::cuda
