// Degenerate triangles told from world space: the answer of SetUpPlane in index space, whatever way it is found.
#include "raster/degenerate.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <random>

namespace voxelpipe {
namespace {

using Triangle = std::array<Vec3d, 3>;

struct Grid {
  Vec3d origin, size;
  double extent;  // of the box that holds all vertices, in voxels from the origin
};

class Triangles {
 public:
  explicit Triangles(const Grid& grid) : grid_(grid) {
    const auto corner = [&](double at) { return Vec3d{at, at, at}; };
    test_ = MakeDegenerateTest({grid.origin, grid.size}, corner(-grid.extent), corner(grid.extent));
  }

  // Edges of up to `edge` voxels; the third corner leaves the line through the others by about `width` of them.
  Triangle Make(double edge, double width) {
    const Vec3d a = Somewhere(grid_.extent - 3 * edge), along = Somewhere(edge), aside = Somewhere(edge * width);
    return {World(a), World(a + along), World(a + along * Number(1) + aside)};
  }

  void Check(const Triangle& t) {
    const auto index = [&](int i) { return WorldToIndex(grid_.origin, grid_.size, t[size_t(i)]); };
    const bool expected = SetUpPlane(index(0), index(1), index(2)).degenerate;
    ASSERT_EQ(IsDegenerate(test_, t[0], t[1], t[2]), expected);
    ++(expected ? degenerate_ : plain_);
  }

  // For a triangle within two voxels along each axis: true if its normal alone proves that it is not degenerate.
  void CheckSmall(const Triangle& t) {
    const auto index = [&](int i) { return WorldToIndex(grid_.origin, grid_.size, t[size_t(i)]); };
    const Vec3d n = Cross(t[1] - t[0], t[2] - t[0]);
    const bool sure = std::fma(n.z, n.z, std::fma(n.y, n.y, n.x * n.x)) >= test_.least_small;
    ASSERT_FALSE(sure && SetUpPlane(index(0), index(1), index(2)).degenerate);
    ++(sure ? plain_ : degenerate_);
  }

  int degenerate() const { return degenerate_; }
  int plain() const { return plain_; }

 private:
  Grid grid_;
  DegenerateTest test_;
  std::mt19937_64 random_{7};
  int degenerate_ = 0, plain_ = 0;

  double Number(double most) { return std::uniform_real_distribution<double>(-most, most)(random_); }
  Vec3d Somewhere(double most) { return {Number(most), Number(most), Number(most)}; }
  Vec3d World(const Vec3d& p) const {
    return {p.x * grid_.size.x + grid_.origin.x, p.y * grid_.size.y + grid_.origin.y,
            p.z * grid_.size.z + grid_.origin.z};
  }
};

TEST(DegenerateTest, AnswersAsThePlaneInIndexSpaceDoes) {
  const Grid grids[] = {
      {{0, 0, 0}, {1.0 / 512, 1.0 / 512, 1.0 / 512}, 512},
      {{-3, 1e3, 0.1}, {0.01, 1e-5, 7}, 1000},
      {{1e9, -1e9, 0}, {1e-3, 1e-3, 1e-3}, 1e12},
      {{0, 0, 0}, {1e-200, 1e-200, 1e-200}, 100},
      {{0, 0, 0}, {1e200, 1e200, 1e200}, 100},
      {{0, 0, 0}, {1e-38, 1e-38, 1e-38}, 100},
      {{0, 0, 0}, {1e46, 1, 1}, 100},
      {{0, 0, 0}, {0x1p-60, 0x1p60, 1}, 100},
  };
  int degenerate = 0, plain = 0;
  for (const Grid& grid : grids) {
    Triangles triangles(grid);
    for (const double edge : {1e-12, 1e-7, 1e-3, 0.3, 10.0}) {
      for (const double width : {0.0, 1e-14, 1e-11, 1e-9, 1e-4, 1e-3, 3e-3, 1.0}) {
        for (int i = 0; i < 200; ++i) triangles.Check(triangles.Make(edge, width));
      }
    }
    degenerate += triangles.degenerate();
    plain += triangles.plain();
  }
  EXPECT_GT(degenerate, 1000);
  EXPECT_GT(plain, 1000);
}

// Triangles that lie beyond walls in whole or in part: flattened there, some are degenerate that were not.
TEST(DegenerateTest, KnowsWhatWallsMove) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> share(-1, 1);
  int flattened = 0, plain = 0;
  for (const double taken : {4e-4, 1e-6, 1e-13}) {
    IndexSpace space{{0.5, -3, 7}, {0.25, 0.125, 1}};
    space.wall = {40, 40, IndexSpace::kNoWall};
    space.wall_end = {40 + taken, 40 + taken, IndexSpace::kNoWall};
    const DegenerateTest test = MakeDegenerateTest(space, {0, 0, 0}, {40, 40, 40});
    for (const double edge : {1e-4, 1e-2, 1.0, 12.0}) {
      for (int i = 0; i < 2000; ++i) {
        Vec3d world[3], index[3];
        for (int v = 0; v < 3; ++v) {
          Vec3d at{40 + taken * (0.5 + 0.45 * share(random)), 20 + edge * share(random), 20 + edge * share(random)};
          if (i % 3 == 1) at.y = 40 + taken * (0.5 + 0.45 * share(random));
          if (i % 3 == 2) at.x -= edge * (1 + share(random));
          for (int a = 0; a < 3; ++a) world[v][a] = space.origin[a] + at[a] * space.voxel_size[a];
          index[v] = WorldToIndex(space, world[v]);
        }
        const bool expected = SetUpPlane(index[0], index[1], index[2]).degenerate;
        ASSERT_EQ(IsDegenerate(test, world[0], world[1], world[2]), expected) << taken << " " << edge << " " << i;
        const Vec3d n = Cross(world[1] - world[0], world[2] - world[0]);
        if (edge <= 1) {
          ASSERT_FALSE(Dot(n, n) >= test.least_small && expected);
        }
        ++(expected ? flattened : plain);
      }
    }
  }
  EXPECT_GT(flattened, 1000);
  EXPECT_GT(plain, 1000);
}

TEST(DegenerateTest, NumbersThatFloatsDoNotHoldGoThePlainWay) {
  const auto check = [](const Vec3d& size, const Vec3d& b, const Vec3d& c) {
    const DegenerateTest test = MakeDegenerateTest({{0, 0, 0}, size}, {-100, -100, -100}, {100, 100, 100});
    EXPECT_TRUE(IsDegenerate(test, {0, 0, 0}, b, c));
  };
  check({1e-38, 1e-38, 1e-38}, {1e-44, 2e-44, 3e-44}, {1.5e-44, 3e-44, 4.5e-44});  // edges of few bits
  check({1e46, 1, 1}, {0, 100, 0}, {1e39, 1e10, 0.2});                             // an edge that overflows
}

TEST(DegenerateTest, PointsAndLinesAreDegenerate) {
  const DegenerateTest test = MakeDegenerateTest({}, {-10, -10, -10}, {10, 10, 10});
  const Vec3d a{1, 2, 3}, b{4, 2, 3}, c{7, 2, 3}, d{1, 2.5, 3};
  EXPECT_TRUE(IsDegenerate(test, a, a, a));
  EXPECT_TRUE(IsDegenerate(test, a, b, a));
  EXPECT_TRUE(IsDegenerate(test, a, b, c));
  EXPECT_FALSE(IsDegenerate(test, a, b, d));
}

TEST(DegenerateTest, SmallTrianglesOfLongNormalsAreNot) {
  const Grid grids[] = {
      {{0, 0, 0}, {1.0 / 512, 1.0 / 512, 1.0 / 512}, 512},
      {{-3, 1e3, 0.1}, {0.01, 1e-5, 7}, 1000},
      {{0, 0, 0}, {1e-7, 1e-7, 1e-7}, 1000},
      {{0, 0, 0}, {1e-5, 1e-5, 1e-5}, 60000},
      {{0, 0, 0}, {1e3, 1e3, 1e3}, 60000},
  };
  int in_doubt = 0, sure = 0;
  for (const Grid& grid : grids) {
    Triangles thin(grid), usual(grid);
    for (const double edge : {1e-4, 1e-2, 0.3, 0.5}) {
      for (const double width : {0.0, 1e-11, 1e-10, 1e-9, 1e-8, 1e-7, 1e-6}) {
        for (int i = 0; i < 200; ++i) thin.CheckSmall(thin.Make(edge, width));
      }
    }
    in_doubt += thin.degenerate();
    sure += thin.plain();
    for (int i = 0; i < 1000; ++i) usual.CheckSmall(usual.Make(0.3, 1));
    EXPECT_GT(usual.plain(), 900);
  }
  EXPECT_GT(in_doubt, 1000);
  EXPECT_GT(sure, 1000);
  // Nothing is certain far from the origin, nor of voxels so small that squares of normals are lost.
  const Grid uncertain[] = {
      {{0, 0, 0}, {1, 1, 1}, 1e6}, {{0, 0, 0}, {1e-9, 1e-9, 1e-9}, 100}, {{0, 0, 0}, {1e46, 1, 1}, 100}};
  for (const Grid& grid : uncertain) {
    Triangles triangles(grid);
    for (int i = 0; i < 100; ++i) triangles.CheckSmall(triangles.Make(0.5, 1));
    EXPECT_EQ(triangles.plain(), 0);
  }
}

}  // namespace
}  // namespace voxelpipe
