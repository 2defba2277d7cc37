// The memory that a run takes, as each backend predicts it (Backend::Predict in stages.h).
#pragma once

#include <cstdint>

#include "grid/grid_spec.h"
#include "job/request.h"

namespace voxelpipe {

struct Footprint {
  uint64_t result_bytes = 0;  // of all arrays together
  uint64_t peak_bytes = 0;    // working set, what is held of the result included, the mesh excluded
  int64_t slab_depth = 1;     // layers worked on at a time
  // The part of peak_bytes that lists take whose lengths are estimates: a run that comes to need more takes it from the
  // job's budget as it counts (pipeline/plan/list_memory.h).
  uint64_t list_bytes = 0;
};

// Bytes of a dense result, which follow from the grid alone; 0 of other results.
uint64_t DenseResultBytes(const VoxelizeRequest& request, const GridSpec& grid);

}  // namespace voxelpipe
