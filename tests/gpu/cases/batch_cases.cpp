#include "gpu/cases/batch_cases.h"

#include <array>
#include <utility>

#include "support/meshes/meshes.h"

namespace voxelpipe::gpu {
namespace {

TargetSpec Target(VoxelFormat format, int components, const char* shader) {
  TargetSpec target;
  target.format = format;
  target.components = components;
  target.blend = format == VoxelFormat::kBit ? Blend::kOr : Blend::kMax;
  target.shader = {shader, {}};
  return target;
}

// Which one matters only where several share a pass: offsets of one's values depend on those before it.
std::vector<std::vector<TargetSpec>> TargetLists() {
  const TargetSpec bit;
  TargetSpec masked = Target(VoxelFormat::kU8, 3, "base_color");
  masked.clear = 7;
  TargetSpec set_where_masked = Target(VoxelFormat::kBit, 1, "emissive");
  set_where_masked.clear = 1;
  return {
      {bit},
      {Target(VoxelFormat::kU32, 1, "triangle_id")},
      {masked, Target(VoxelFormat::kF16, 2, "metallic_roughness"),
       set_where_masked},  // fragments that all discard are none
      {bit, masked, Target(VoxelFormat::kU16, 1, "packed_normal")},
      {Target(VoxelFormat::kBit, 1, "base_color")},
      {Target(VoxelFormat::kF32, 4, "normal"), Target(VoxelFormat::kF32, 3, "position")},
      {bit, bit},
      {Target(VoxelFormat::kU8, 1, "occupancy")},
      {Target(VoxelFormat::kBit, 1, "checker"), set_where_masked, Target(VoxelFormat::kF16, 1, "coverage_fraction")},
  };
}

}  // namespace

std::vector<ParityCase> FragmentCases() {
  constexpr std::array<int64_t, 3> kDims[] = {{40, 40, 40}, {1, 1, 1}, {33, 9, 7}, {31, 17, 41}, {1, 40, 1}};
  std::vector<ParityCase> cases;
  size_t number = 0;
  for (const std::vector<TargetSpec>& targets : TargetLists()) {
    for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin}) {
      VoxelizeRequest& request = cases.emplace_back().request;
      request.result = ResultKind::kBuckets;
      request.coverage = coverage;
      request.layout = Layout(number / 2 % 2);
      request.targets = targets;
      const std::array<int64_t, 3>& dims = kDims[number % std::size(kDims)];
      request.grid.dims = dims;
      request.grid.origin = Vec3d{0, 0, 0};
      request.grid.voxel_size = dims[0] == 1 && dims[1] == 1 ? Vec3d{40, 40, 40} : Vec3d{1, 1, 1};
      ++number;
    }
  }
  cases.push_back(cases.front());
  cases.back().request.coverage = Coverage::kCenter;
  // Occupancy bits of a grid that is too long for rows: its fragments are found, and no target has values.
  ParityCase& bits = cases.emplace_back();
  bits.request.grid.dims = {17000, 3, 2};
  bits.request.grid.origin = Vec3d{0, 0, 0};
  bits.request.grid.voxel_size = Vec3d{0.0025, 13, 20};
  return cases;
}

VoxelizeRequest FittedABuffer(int64_t resolution, bool shaded) {
  VoxelizeRequest request;
  request.result = ResultKind::kBuckets;
  request.grid.resolution = resolution;
  request.grid.fit = GridFit::kCube;
  if (shaded) request.targets[0] = Target(VoxelFormat::kF32, 3, "position");
  return request;
}

std::vector<ParityCase> FloodCases() {
  struct Grid {
    std::array<int64_t, 3> dims;
    Vec3d voxel_size;
  };
  const Grid grids[] = {
      {{40, 40, 40}, {1, 1, 1}},
      {{1, 1, 1}, {40, 40, 40}},
      {{33, 9, 7}, {1, 1, 1}},
      {{32, 32, 32}, {1.25, 1.25, 1.25}},
      {{64, 33, 17}, {0.625, 1.25, 2.5}},
      {{31, 17, 41}, {1, 2, 1}},
      {{1, 40, 1}, {40, 1, 40}},
      {{97, 5, 12}, {0.4, 8, 3.5}},
      {{20, 20, 20}, {0.5, 0.5, 0.5}},  // the mesh goes beyond
      {{65, 66, 67}, {0.62, 0.61, 0.6}},
  };
  std::vector<ParityCase> cases;
  for (const ResultKind kind : {ResultKind::kDense, ResultKind::kSparse}) {
    for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter}) {
      for (const std::vector<TargetSpec>& targets : TargetLists()) {
        const size_t number = cases.size();
        VoxelizeRequest& request = cases.emplace_back().request;
        request.result = kind;
        request.coverage = coverage;
        request.fill = Fill::kFlood;
        request.layout = Layout(number / 2 % 2);
        request.targets = targets;
        for (TargetSpec& target : request.targets) {
          if (number % 3 == 1) target.fill_values = {target.format == VoxelFormat::kBit ? 0.0 : 9.0};
          if (number % 5 == 2) target.clear = target.format == VoxelFormat::kBit ? 1 : 3;
        }
        const Grid& grid = grids[number % std::size(grids)];
        request.grid.dims = grid.dims;
        request.grid.origin = Vec3d{0, 0, 0};
        request.grid.voxel_size = grid.voxel_size;
      }
    }
  }
  return cases;
}

VoxelizeRequest FloodOfLabyrinth(bool shaded) {
  VoxelizeRequest request;
  request.fill = Fill::kFlood;
  request.coverage = shaded ? Coverage::kThin : Coverage::kConservative;
  request.grid.dims = {21, 21, 21};
  request.grid.origin = Vec3d{0, 0, 0};
  request.grid.voxel_size = Vec3d{1, 1, 1};
  if (shaded) request.targets[0] = Target(VoxelFormat::kU32, 1, "triangle_id");
  return request;
}

TriangleMesh Labyrinth(int levels) {
  std::vector<Vec3d> positions;
  std::vector<std::array<uint32_t, 3>> triangles;
  // Closes voxels [begin, end] along two axes, and those at `at` along the third; through their centres.
  const auto wall = [&](int axis, int at, int b0, int e0, int b1, int e1) {
    const auto first = uint32_t(positions.size());
    for (int i = 0; i < 4; ++i) {
      Vec3d p;
      p[axis] = at + 0.5;
      p[(axis + 1) % 3] = (i & 1 ? e0 : b0) + 0.5;
      p[(axis + 2) % 3] = (i & 2 ? e1 : b1) + 0.5;
      positions.push_back(p);
    }
    triangles.push_back({first, first + 1, first + 2});
    triangles.push_back({first + 3, first + 2, first + 1});
  };
  // Levels lie behind each other along x, passages of one beside each other along z, and lead along y.
  const int top = 2 * levels;
  for (const int end : {0, 20}) {
    wall(1, end, 0, 20, 0, top);
    wall(2, end, 0, top, 0, 20);
  }
  for (int level = 0; level < levels; ++level) {
    const int x = 2 * level + 1;
    // What is before the level, but for a hole at the begin of its first passage, which is at the other end of every
    // other level.
    const bool at_end = level % 2 == 1;
    wall(0, x - 1, 0, 20, at_end ? 0 : 2, at_end ? 18 : 20);
    wall(0, x - 1, 2, 20, at_end ? 18 : 0, at_end ? 20 : 1);
    for (int passage = 0; passage < 9; ++passage) {
      const bool gap_at_end = passage % 2 == 0;
      wall(2, 2 * passage + 2, x - 1, x + 1, gap_at_end ? 0 : 2, gap_at_end ? 18 : 20);
    }
  }
  wall(0, top, 0, 20, 0, 20);
  return testing::MakeMesh(std::move(positions), std::move(triangles));
}

}  // namespace voxelpipe::gpu
