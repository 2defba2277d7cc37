#include "gpu/cases/fine_mesh_cases.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace voxelpipe::gpu {

std::vector<ParityCase> BrickCases(const ParityMesh& named, size_t triangles) {
  std::vector<ParityCase> cases;
  if (named.extent <= 0 || triangles < 500 || triangles > 80'000) return cases;
  const auto n = int64_t(2 * std::sqrt(double(triangles)));
  const auto add = [&](std::array<int64_t, 3> dims, double from, Coverage coverage, int64_t slab_depth,
                       double part = 1) {
    const double voxel = named.extent / double(n) / part;
    ParityCase c;
    c.request.grid = Placed(dims, {from * voxel, -from * voxel, from * voxel}, {voxel, 1.03 * voxel, voxel});
    c.request.coverage = coverage;
    c.slab_depth = slab_depth;
    cases.push_back(c);
  };
  const int64_t whole = (n + 127) / 128 * 128;  // rows of whole units of 16 bytes
  add({n, n, n}, 0, Coverage::kConservative, 0);
  add({whole, n - 3, n + 5}, 0, Coverage::kThin, 0);
  add({n + 40, n + 1, n - 9}, 3.5, Coverage::kConservative, 24);
  add({whole, n + 6, n}, -2.25, Coverage::kConservative, 0);
  // In a part of the grid, so that triangles are about a voxel large.
  add({n, n, n}, 0, Coverage::kConservative, 0, 0.3);
  add({n, n, n}, 0.5, Coverage::kThin, 24, 0.4);
  return cases;
}

std::vector<ParityCase> RowCases(const ParityMesh& named, size_t triangles) {
  std::vector<ParityCase> cases;
  if (named.extent <= 0 || triangles < 4000 || triangles > 80'000) return cases;
  const auto n = int64_t(std::sqrt(double(triangles)));
  const double voxel = named.extent / double(n);
  const auto add = [&](std::array<int64_t, 3> dims, double from, Coverage coverage, int64_t slab_depth) {
    ParityCase c;
    c.request.grid = Placed(dims, {from * voxel, -from * voxel, from * voxel}, {voxel, 0.98 * voxel, voxel});
    c.request.coverage = coverage;
    c.slab_depth = slab_depth;
    cases.push_back(c);
  };
  add({n, n, n}, 0, Coverage::kConservative, 0);
  add({n - 3, n, n - 1}, 0.5, Coverage::kThin, 0);
  add({n, n - 5, n}, -7.25, Coverage::kConservative, 0);  // some triangles outside
  add({n - 1, n, n}, 3.5, Coverage::kThin, n * 2 / 3);
  return cases;
}

std::vector<ParityCase> FourCases(const ParityMesh& named) {
  std::vector<ParityCase> cases;
  if (named.extent <= 0) return cases;
  const auto e = int64_t(named.extent);
  const double third = named.extent / 3;
  const GridRequest grids[4] = {Placed({e, e, e}, {0, 0, 0}, {1, 1, 1}), Placed({65, 17, 23}, {0, 0, 0}, {1, 1, 1}),
                                Placed({e, e - 3, e + 2}, {-1.25, 0.5, 2}, {0.75, 1, 4.0 / 3}),
                                Placed({97, 41, 53}, {third, third, named.extent / 4}, {0.1, 0.125, 0.3})};
  constexpr Coverage kFineCoverages[3] = {Coverage::kConservative, Coverage::kThin, Coverage::kCenter};
  constexpr const char* kShaders[3] = {"normal", "geometric_normal", "triangle_id"};
  for (size_t i = 0; i < 12; ++i) {
    ParityCase c;
    c.request.grid = grids[i % 4];
    c.request.coverage = kFineCoverages[i / 2 % 3];
    if (i % 4 == 3) c.request.fill = Fill::kParity;
    TargetSpec& target = c.request.targets[0];
    target.format = VoxelFormat::kF32;
    target.components = 4;
    target.blend = i % 2 == 0 ? Blend::kMax : Blend::kMin;
    target.shader = {kShaders[(i + i / 6) % 3], {}};
    if (i % 5 == 3) c.request.targets.emplace_back();  // of occupancy
    c.slab_depth = i % 7 == 6 ? 8 : 0;
    cases.push_back(c);
  }
  return cases;
}

std::vector<ParityCase> BundleCases(const ParityMesh& named, size_t triangles) {
  std::vector<ParityCase> cases;
  if (named.extent <= 0 || triangles < 500 || triangles > 80'000) return cases;
  const auto side = int64_t(std::sqrt(double(triangles) / 2));
  const auto add = [&](double part, double from, Coverage coverage, int64_t slab_depth = 0) {
    const auto n = std::max(int64_t(1), int64_t(part * double(side)));
    const double voxel = named.extent / double(n);
    ParityCase c;
    c.request.grid = Placed({n, n + 1, n}, {from * voxel, -from * voxel, from * voxel}, {voxel, 0.97 * voxel, voxel});
    c.request.coverage = coverage;
    c.request.result = ResultKind::kBuckets;
    c.slab_depth = slab_depth;
    cases.push_back(c);
  };
  add(0.1, 0, Coverage::kConservative);  // one voxel of many triangles that follow one another
  add(0.5, 0, Coverage::kThin);
  add(1, 0, Coverage::kConservative);
  add(1, -0.5, Coverage::kThin, 16);        // others outside
  add(1.2, 0.25, Coverage::kConservative);  // of some eleven voxels a triangle: larger ones are not bundled
  add(1.2, 0, Coverage::kThin);
  add(1.75, 0, Coverage::kThin);
  add(1, 0, Coverage::kConservative);
  cases.back().request.targets.resize(3);
  return cases;
}

}  // namespace voxelpipe::gpu
