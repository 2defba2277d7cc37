// Exposed faces of one colour, merged to rectangles.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <vector>

#include "absl/status/statusor.h"
#include "encode/drawn/exposed_faces.h"

namespace voxelpipe {

// A rectangle on one side (exposed_faces.h) of the voxels from `low` to `high`, both included.
struct MergedFace {
  std::array<int64_t, 3> low, high;
  uint64_t colour;
  int side;
};

// In: the colour of a solid voxel by its linear index, as any number; a job, which may be null; a charge to its memory,
// which gets that of the list. Out: rectangles that
// cover each exposed face once, in a fixed order: runs of faces along a row, joined with equal runs of the next row.
absl::StatusOr<std::vector<MergedFace>> MergeFaces(const PreviewVolume& volume,
                                                   const std::function<uint64_t(uint64_t n)>& colour_of,
                                                   const JobContext* job, MemoryCharge& memory);

}  // namespace voxelpipe
