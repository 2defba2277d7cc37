// The grids that OpenVDB's family of formats holds of a result. Integer coordinates are the centres of voxels.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "absl/container/flat_hash_set.h"
#include "absl/status/statusor.h"
#include "absl/strings/str_cat.h"
#include "encode/drawn/whole_file.h"

namespace voxelpipe {

// Position of the centre of voxel 0.
inline Vec3d FirstCentre(const GridSpec& grid) {
  const Vec3d &h = grid.voxel_size, &o = grid.origin;
  return {o.x + h.x / 2, o.y + h.y / 2, o.z + h.z / 2};
}

// The nodes of the tree of a grid: of 8, 128 and 4096 voxels a side.
struct VdbNodes {
  uint64_t leaves = 0, lower = 0, upper = 0;
};

// A leaf is a brick of the volume. Errors: the job's.
inline absl::StatusOr<VdbNodes> CountNodes(const PreviewVolume& volume, const JobContext* job) {
  using Node = std::array<int64_t, 3>;
  VdbNodes nodes;
  absl::flat_hash_set<Node> lower, upper;  // much smaller than the nodes
  Node last{-1, -1, -1};
  const absl::Status s = volume.VisitBricks(job, [&](int64_t x, int64_t y, int64_t z) {
    ++nodes.leaves;
    const Node node{x / 16, y / 16, z / 16};
    if (node == last) return;
    last = node;
    lower.insert(node);
    upper.insert({x / 512, y / 512, z / 512});
  });
  if (!s.ok()) return s;
  nodes.lower = lower.size();
  nodes.upper = upper.size();
  return nodes;
}

// Adds the grids in the order of the file: the fog volume "density", which is 1 at solid voxels, and of each target
// that is not bits a vector of the first three components and a scalar of each other one. `grids` has
//   absl::Status AddFog(name, value), AddScalar(name, value): value(n) is the float of the voxel of linear index n
//   absl::Status AddVector(name, value): value(n) is std::array<float, 3>
template <typename Grids>
absl::Status AddGrids(const DrawnResult& drawn, Grids& grids) {
  absl::Status s = grids.AddFog("density", [](uint64_t) { return 1.0f; });
  const PreviewItems& items = drawn.colours.items();
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
