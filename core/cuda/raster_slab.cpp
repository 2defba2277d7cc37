// Rasterizes, shades and blends the triangles of a slab.
#include "cuda/run/run_state.h"

namespace voxelpipe::cuda {

absl::Status FineRaster(RunState& state) {
  if (state.plan.path == Path::kNothing) return absl::OkStatus();
  if (state.plan.path == Path::kOccupancy) {
    return RasterRows(state, state.request.request.coverage, state.slab.begin, state.slab.end, state.coverage.data(),
                      state.coverage.size());
  }
  return BlendDirectly(state);
}

}  // namespace voxelpipe::cuda
