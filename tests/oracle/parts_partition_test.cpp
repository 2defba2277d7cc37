// Parts that fill space together: each centre is in exactly one of them, and their volumes come out.
#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "oracle/parts/assembly.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

TriangleMesh AsNodes(const std::vector<Body>& bodies) {
  std::vector<TaggedBody> tagged;
  for (const Body& body : bodies) {
    TaggedBody& of = tagged.emplace_back();
    of.body = body;
    of.node = of.instance = uint32_t(tagged.size() - 1);
    of.node_name = "n" + std::to_string(of.node);
  }
  return WriteMesh(tagged, {});
}

// Labels from 1 by voxel, 0 outside; with `reversed` the first part has the highest rank.
std::vector<uint32_t> Labels(const TriangleMesh& mesh, const GridRequest& grid, Fill fill, bool reversed) {
  VoxelizeRequest request;
  request.grid = grid;
  request.coverage = Coverage::kNone;
  request.fill = fill;
  request.parts.scope = PartScope::kNode;
  if (reversed) {
    for (size_t n = 0; n < mesh.parts.size(); ++n) {
      request.parts.priorities.push_back({"n" + std::to_string(n), -int64_t(n)});
    }
  }
  request.targets = {TargetOf(VoxelFormat::kU32, 1, Blend::kReplace, {"label", {}})};
  const VoxelizeResult result = RunPipeline(mesh, request);
  EXPECT_EQ(result.stats.odd_columns, 0u);
  std::vector<uint32_t> labels(result.grid.voxels());
  for (uint64_t n = 0; n < labels.size(); ++n) labels[n] = ValueAt<uint32_t>(result.targets[0], n);
  EXPECT_EQ(result.stats.occupied, labels.size() - size_t(std::count(labels.begin(), labels.end(), 0u)));
  return labels;
}

// Cuts a box in two at a coordinate, again and again.
std::vector<std::pair<Vec3d, Vec3d>> CutBoxes(int count, const Vec3d& low, const Vec3d& high, std::mt19937& random) {
  std::vector<std::pair<Vec3d, Vec3d>> boxes = {{low, high}};
  while (int(boxes.size()) < count) {
    const size_t i = random() % boxes.size();
    const auto axis = int(random() % 3);
    auto [a, b] = boxes[i];
    const auto steps = int(2 * (b[axis] - a[axis]));
    if (steps < 2) continue;
    const double at = a[axis] + 0.5 * (1 + int(random() % uint32_t(steps - 1)));
    boxes[i].second[axis] = at;
    a[axis] = at;
    boxes.emplace_back(a, b);
  }
  return boxes;
}

// Faces lie on planes of voxel centres: of the boxes beside one, that on the far side of x and y has the centre.
TEST(PartsPartitionTest, BoxesThatShareFacesShareNoCentre) {
  std::mt19937 random(5);
  for (int round = 0; round < 6; ++round) {
    const auto boxes = CutBoxes(4 << round % 4, {0.5, 1.5, 1}, {11.5, 12, 12.5}, random);
    std::vector<Body> bodies;
    for (const auto& [low, high] : boxes) {
      bodies.push_back(Box(low, high));
      if (random() % 2 == 0) bodies.back() = InsideOut(bodies.back());
    }
    const TriangleMesh mesh = AsNodes(bodies);
    for (const Fill fill : {Fill::kParity, Fill::kNonzero}) {
      const std::vector<uint32_t> labels = Labels(mesh, UnitGrid(13, 14, 15), fill, false);
      EXPECT_EQ(Labels(mesh, UnitGrid(13, 14, 15), fill, true), labels) << "a centre in two boxes";
      uint64_t n = 0;
      for (int z = 0; z < 15; ++z) {
        for (int y = 0; y < 14; ++y) {
          for (int x = 0; x < 13; ++x, ++n) {
            const Vec3d c{x + 0.5, y + 0.5, z + 0.5};
            uint32_t want = 0;
            bool tie = false;
            for (uint32_t b = 0; b < boxes.size(); ++b) {
              const auto& [low, high] = boxes[b];
              if (c.x < low.x || c.x >= high.x || c.y < low.y || c.y >= high.y || c.z < low.z || c.z > high.z) continue;
              want = b + 1;
              tie = tie || c.z == low.z || c.z == high.z;
            }
            if (tie) continue;
            ASSERT_EQ(labels[n], want) << x << "," << y << "," << z;
          }
        }
      }
    }
  }
}

// The six tetrahedra around the diagonal of each cell of a lattice.
std::vector<Body> Tetrahedra(int cells, const std::vector<Vec3d>& points) {
  constexpr int kOrders[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
  const auto at = [&](const std::array<int, 3>& p) {
    return points[size_t(p[0] + (cells + 1) * (p[1] + (cells + 1) * p[2]))];
  };
  std::vector<Body> bodies;
  for (int cell = 0; cell < cells * cells * cells; ++cell) {
    for (int o = 0; o < 6; ++o) {
      std::array<int, 3> p = {cell % cells, cell / cells % cells, cell / cells / cells};
      Body& body = bodies.emplace_back();
      body.positions.push_back(at(p));
      for (const int axis : kOrders[o]) ++p[size_t(axis)], body.positions.push_back(at(p));
      body.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
      if (o >= 3) body = InsideOut(body);  // these orders are mirrored
    }
  }
  return bodies;
}

// Inner lattice points are moved, or lie where faces pass voxel centres; all centres within the cube are in one part.
TEST(PartsPartitionTest, TetrahedraThatShareFacesShareNoCentre) {
  std::mt19937 random(8);
  for (int round = 0; round < 4; ++round) {
    constexpr int kCells = 3;
    std::vector<Vec3d> points;
    for (int z = 0; z <= kCells; ++z) {
      for (int y = 0; y <= kCells; ++y) {
        for (int x = 0; x <= kCells; ++x) {
          Vec3d& p = points.emplace_back(Vec3d{4.0 * x + 1, 4.0 * y + 1, 4.0 * z + 1});
          const std::array<int, 3> i = {x, y, z};
          for (int a = 0; a < 3; ++a) {
            if (i[size_t(a)] % kCells == 0) continue;
            p[a] +=
                round < 2 ? 0.5 * (int(random() % 3) - 1) : std::uniform_real_distribution<double>(-0.9, 0.9)(random);
          }
        }
      }
    }
    const TriangleMesh mesh = AsNodes(Tetrahedra(kCells, points));
    for (const Fill fill : {Fill::kParity, Fill::kNonzero}) {
      const std::vector<uint32_t> labels = Labels(mesh, UnitGrid(14, 14, 14), fill, false);
      EXPECT_EQ(Labels(mesh, UnitGrid(14, 14, 14), fill, true), labels) << "a centre in two tetrahedra";
      uint64_t n = 0;
      for (int z = 0; z < 14; ++z) {
        for (int y = 0; y < 14; ++y) {
          for (int x = 0; x < 14; ++x, ++n) {
            const bool within = std::min({x, y, z}) >= 1 && std::max({x, y, z}) <= 12;
            ASSERT_EQ(labels[n] != 0, within) << x << "," << y << "," << z;
          }
        }
      }
    }
  }
}

// Bodies beside each other, turned so that no face lies along the grid.
std::vector<Body> AnalyticBodies() {
  const Mat4d turns[] = {Rotation({0.6, 0, 0.8}, 0.4), Rotation({0, 0.6, 0.8}, 1.1), Rotation({0.8, 0.6, 0}, 0.7),
                         Rotation({0, 0.8, 0.6}, 2.0)};
  return {Moved(Box({-0.5, -0.4, -0.3}, {0.5, 0.4, 0.3}), Placing(turns[0], 0.7, {0, 0, 0})),
          Moved(Icosphere(3), Placing(turns[1], 0.45, {1.013, 0.021, 0})),
          Moved(Cylinder(48), Placing(turns[2], 0.34, {0.017, 1.031, 0})),
          Moved(BodyOf(Torus(32)), Placing(turns[3], 0.33, {1.007, 1.011, 0.013}))};
}

TEST(PartsPartitionTest, LabelsHoldTheVolumesOfTheirBodies) {
  const std::vector<Body> bodies = AnalyticBodies();
  const TriangleMesh mesh = AsNodes(bodies);
  for (const int steps : {50, 100, 200}) {
    const double h = 1.0 / steps;
    GridRequest grid = UnitGrid(2 * steps + 3, 2 * steps + 3, steps + 2);
    grid.voxel_size = Vec3d{h, h, h};
    grid.origin = Vec3d{-0.5 - h, -0.5 - h, -0.5 - h};
    for (const Fill fill : {Fill::kParity, Fill::kNonzero}) {
      if (fill == Fill::kParity && steps == 200) continue;
      const std::vector<uint32_t> labels = Labels(mesh, grid, fill, false);
      for (size_t b = 0; b < bodies.size(); ++b) {
        const double counted = double(std::count(labels.begin(), labels.end(), uint32_t(b + 1))) * h * h * h;
        EXPECT_NEAR(counted, VolumeOf(bodies[b]), 0.05 * h * AreaOf(bodies[b])) << "body " << b << ", 1/" << steps;
      }
    }
  }
}

}  // namespace
}  // namespace voxelpipe
