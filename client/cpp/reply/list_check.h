// Checks that the lists of a sparse or bucketed result agree with each other and with the grid.
#pragma once

#include <vector>

#include "absl/status/status.h"
#include "job/result.h"

namespace voxelpipe {

// Ensures that code that uses an index or an offset of a server's result stays inside the arrays.
//   sparse   bricks ascend and lie in the grid; no mask is empty or has a bit outside the grid; the masks have as many
//            bits as there are announced values
//   buckets  voxels ascend and lie in the grid; offsets begin with 0, ascend (each voxel has a fragment) and end with
//            the number of fragments; triangles ascend within a voxel
//   parts    CheckParts
// In: a result, with arrays as announced in the header. DATA_LOSS naming array and entry.
absl::Status CheckLists(const VoxelizeResult& result, const std::vector<ArraySpec>& announced);
// CheckParts of a server's table.
absl::Status CheckTable(const PartTable& parts);

}  // namespace voxelpipe
