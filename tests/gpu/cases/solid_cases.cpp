#include "gpu/cases/solid_cases.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace voxelpipe::gpu {
namespace {

TargetSpec Target(VoxelFormat format, int components, Blend blend, ShaderCall shader) {
  TargetSpec target;
  target.format = format;
  target.components = components;
  target.blend = blend;
  target.shader = std::move(shader);
  return target;
}

// One target for each way in which a filled voxel gets its value.
std::vector<TargetSpec> FilledByShaders() {
  std::vector<TargetSpec> targets = {
      Target(VoxelFormat::kF32, 3, Blend::kAverage, {"velocity", {}}),
      Target(VoxelFormat::kF16, 4, Blend::kReplace, {"position", {}}),
      Target(VoxelFormat::kU8, 2, Blend::kMax, {"checker", {{"size", {3}}, {"odd", {200}}}}),
      Target(VoxelFormat::kU16, 4, Blend::kAdd, {"constant", {{"value", {1.5, 300, -2}}}}),
      Target(VoxelFormat::kU32, 1, Blend::kCount, {"occupancy", {}}),
      Target(VoxelFormat::kF32, 4, Blend::kMin, {"normal", {}}),
      Target(VoxelFormat::kU8, 3, Blend::kMin, {"base_color", {}}),
      Target(VoxelFormat::kBit, 1, Blend::kAnd, {"checker", {}}),
  };
  targets[5].clear = -2.5;
  targets[6].fill_values = {1, 20, 300};
  return targets;
}

std::vector<TargetSpec> Encoded() {
  std::vector<TargetSpec> targets;
  for (const Blend blend : {Blend::kReplace, Blend::kFirst, Blend::kMin, Blend::kMax, Blend::kAdd, Blend::kAverage}) {
    const ShaderCall shader{targets.size() % 2 == 0 ? "base_color" : "color", {}};
    targets.push_back(Target(VoxelFormat::kU8, 4 - int(targets.size() % 3), blend, shader));
  }
  targets.push_back(Target(VoxelFormat::kU8, 4, Blend::kAdd, {"constant", {{"value", {0.2, 0.01, 0.5, 0.3}}}}));
  targets.push_back(Target(VoxelFormat::kU8, 1, Blend::kMax, {"constant", {{"value", {0.2}}}}));
  for (TargetSpec& target : targets) target.encoding = Encoding::kSrgb;
  targets[0].fill_values = {17};
  targets[1].clear = 99;
  return targets;
}

}  // namespace

GridRequest WalledGrid(const TriangleMesh& mesh, int64_t n, double share) {
  Vec3d least{HUGE_VAL, HUGE_VAL, HUGE_VAL}, most{-HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
  for (const auto& t : mesh.triangles) {
    for (const uint32_t v : t) {
      for (int a = 0; a < 3; ++a) {
        least[a] = std::min(least[a], mesh.positions[v][a]);
        most[a] = std::max(most[a], mesh.positions[v][a]);
      }
    }
  }
  GridRequest grid;
  Vec3d size{1, 1, 1};
  for (int a = 0; a < 3; ++a) {
    const double extent = most[a] - least[a], voxels = double(n + 3 * a);
    if (!(extent > 0)) continue;
    // What walls take grows with the number of voxels from the origin, up to 4e-4.
    const double farthest = std::max(std::abs(least[a]), std::abs(most[a])) * voxels / extent;
    const double slack = std::clamp(farthest * 0x1p-22, 1e-9, 4e-4);
    size[a] = extent / (voxels + share * slack);
  }
  grid.voxel_size = size;
  return grid;
}

std::vector<ParityCase> SolidCases(const TriangleMesh& mesh, bool quick) {
  std::vector<ParityCase> cases;
  const auto add = [&](ResultKind kind, Coverage coverage, Fill fill, const GridRequest& grid,
                       std::vector<TargetSpec> targets) -> ParityCase& {
    ParityCase c;
    c.request.grid = grid;
    c.request.result = kind;
    c.request.coverage = coverage;
    c.request.fill = fill;
    if (!targets.empty()) c.request.targets = std::move(targets);
    c.request.vertex_shader.parameters["angular_velocity"] = {0.5, -3, 0.25};
    c.request.vertex_shader.parameters["center"] = {3, 20, 11};
    c.request.layout = Layout(cases.size() / 2 % 2);
    c.slab_depth = cases.size() % 4 == 3 ? 8 : 0;
    cases.push_back(c);
    return cases.back();
  };
  std::vector<GridRequest> grids = {WalledGrid(mesh, 24, 0.7)};
  if (!quick) {
    grids.push_back(WalledGrid(mesh, 61, 0.99));
    grids.push_back(WalledGrid(mesh, 5, 0.4));
    grids.back().padding = 2;
    grids.push_back(Placed({37, 30, 41}, {1.25, -3, 0.5}, {1, 1.5, 0.75}));
  }
  for (const GridRequest& grid : grids) {
    for (const Fill fill : {Fill::kParity, Fill::kNonzero}) {
      for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse}) {
        add(kind, Coverage::kNone, fill, grid, {});
        add(kind, Coverage::kNone, fill, grid, FilledByShaders());
        if (quick && fill == Fill::kParity) continue;
        add(kind, Coverage::kThin, fill, grid, {});
        add(kind, Coverage::kConservative, fill, grid, FilledByShaders());
        add(kind, Coverage::kConservative, fill, grid, {FilledByShaders()[0]});
        add(kind, Coverage::kNone, fill, grid, {Encoded()[6]});
      }
    }
    for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter}) {
      for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse, ResultKind::kBuckets}) {
        if (kind == ResultKind::kBuckets && coverage == Coverage::kCenter) continue;
        add(kind, coverage, Fill::kNone, grid, {});  // walls, by each way to rasterize
        add(kind, coverage, Fill::kNone, grid, {Target(VoxelFormat::kF32, 1, Blend::kMax, {"triangle_id", {}})});
        add(kind, coverage, Fill::kNone, grid, Encoded());
        if (quick) continue;
        for (const TargetSpec& target : Encoded()) add(kind, coverage, Fill::kNone, grid, {target});
      }
    }
  }
  return cases;
}

}  // namespace voxelpipe::gpu
