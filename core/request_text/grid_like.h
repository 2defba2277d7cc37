// The option grid_like: the grid of an earlier result.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "absl/status/statusor.h"
#include "base/vec.h"

namespace voxelpipe {

// Where a result lies in the world.
struct GridPlace {
  std::array<int64_t, 3> dims{};  // nx, ny, nz; each at least 1
  Vec3d origin{};                 // the corner of the first voxel, world units
  Vec3d voxel_size{};             // world units, each > 0
};

// In: the path of an OUT.raw.json, of the one summary that `voxelize --json` printed, or of an .npz of ours. Out: its
// dims, origin and voxel size. Errors: INVALID_ARGUMENT for a file without them (every .npy), for several summaries and
// for values that are none of a grid; NOT_FOUND and the system's with its reason. They do not name the path.
absl::StatusOr<GridPlace> ReadGridPlace(const std::string& path);

}  // namespace voxelpipe
