// The grids that OpenVDB's family of formats holds of a result. Integer coordinates are the centres of voxels.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "absl/strings/str_cat.h"
#include "encode/drawn/whole_file.h"

namespace voxelpipe {

// Position of the centre of voxel 0.
inline Vec3d FirstCentre(const GridSpec& grid) {
  const Vec3d &h = grid.voxel_size, &o = grid.origin;
  return {o.x + h.x / 2, o.y + h.y / 2, o.z + h.z / 2};
}

// Numbers by voxel in all grids.
inline uint64_t NumbersInGrids(const VoxelizeResult& result) {
  uint64_t numbers = 1;  // density
  for (const TargetSpec& spec : result.specs) {
    if (spec.format != VoxelFormat::kBit) numbers += uint64_t(spec.components);
  }
  return numbers;
}

// Adds the grids in the order of the file: the fog volume "density", which is 1 at solid voxels, and of each target
// that is not bits a vector of the first three components and a scalar of each other one. `grids` has
//   absl::Status AddFog(name, value), AddScalar(name, value): value(n) is the float of the voxel of linear index n
//   absl::Status AddVector(name, value): value(n) is std::array<float, 3>
template <typename Grids>
absl::Status AddGrids(const DrawnResult& drawn, Grids& grids) {
  absl::Status s = grids.AddFog("density", [](uint64_t) { return 1.0f; });
  const PreviewItems items(drawn.result);
  for (size_t t = 0; t < drawn.result.specs.size() && s.ok(); ++t) {
    const TargetSpec& spec = drawn.result.specs[t];
    if (spec.format == VoxelFormat::kBit) continue;
    const TargetValues values(drawn.result, t, items.count());
    const std::string name = absl::StrCat("target", t);
    // Colours as fractions, as readers want them.
    const float unit = spec.format == VoxelFormat::kU8 && spec.components >= 3 ? 1 / 255.0f : 1;
    const auto number = [&](uint64_t n, int c) { return values.At(items.Find(n), c) * unit; };
    int first = 0;  // of the components that have grids of their own
    if (spec.components >= 3) {
      s = grids.AddVector(name, [&](uint64_t n) {
        return std::array<float, 3>{number(n, 0), number(n, 1), number(n, 2)};
      });
      first = 3;
    }
    for (int c = first; c < spec.components && s.ok(); ++c) {
      const std::string own = spec.components == 1 ? name : absl::StrCat(name, "_", c);
      s = grids.AddScalar(own, [&](uint64_t n) { return number(n, c); });
    }
  }
  return s;
}

}  // namespace voxelpipe
