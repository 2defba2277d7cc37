#include "raster/triangle_setup.h"

#include <cmath>
#include <cstring>

#include "gtest/gtest.h"
#include "raster/crossing.h"
#include "raster/spans.h"
#include "raster/tiles.h"
#include "support/meshes/meshes.h"

namespace voxelpipe {
namespace {

using namespace testing;

TEST(TriangleSetupTest, PowerOfTwoAboveIsStrictlyAbove) {
  EXPECT_EQ(PowerOfTwoAbove(1.0), 2.0);
  EXPECT_EQ(PowerOfTwoAbove(1.5), 2.0);
  EXPECT_EQ(PowerOfTwoAbove(0.75), 1.0);
  EXPECT_EQ(PowerOfTwoAbove(0x1p-800), 0x1p-799);
}

// A sliver whose normal is lost in plain double products: cross is (0, 0, 2^-60) for edges near (1, 1).
TEST(TriangleSetupTest, CrossProductsKeepTheirPrecision) {
  const double tiny = 0x1p-30;
  EXPECT_EQ(DifferenceOfProducts(1 + tiny, 1 - tiny, 1.0, 1.0), -tiny * tiny);
}

TEST(TriangleSetupTest, DegenerateByTheDefinition) {
  const auto degenerate = [](Vec3d a, Vec3d b, Vec3d c) { return SetUpPlane(a, b, c).degenerate; };
  EXPECT_TRUE(degenerate({1, 2, 3}, {1, 2, 3}, {1, 2, 3}));
  EXPECT_TRUE(degenerate({0, 0, 0}, {1, 2, 3}, {2, 4, 6}));
  EXPECT_TRUE(degenerate({0, 0, 0}, {10, 0, 0}, {5, 0.9e-9, 0}));
  EXPECT_FALSE(degenerate({0, 0, 0}, {10, 0, 0}, {5, 1.1e-9, 0}));
  EXPECT_FALSE(degenerate({0, 0, 0}, {1e-200, 0, 0}, {0, 1e-200, 0}));  // tiny is not degenerate
  EXPECT_FALSE(degenerate({0, 0, 0}, {1e12, 0, 0}, {0, 1e12, 0}));
}

// A degenerate triangle covers what its longest edge covers, whichever of the three that is.
TEST(TriangleSetupTest, DegenerateCountsAsItsLongestEdge) {
  const Vec3d a{0.5, 0.5, 0.5}, b{6.5, 3.5, 2.0}, between{2.5, 1.5, 1.0};
  const VoxelRange all{{0, 0, 0}, {8, 8, 8}};
  const auto voxels = [&](Vec3d p, Vec3d q, Vec3d r) {
    std::vector<std::array<int64_t, 4>> rows;
    ForEachRowSpan(SetUpTriangle(p, q, r, Coverage::kCenter), all, [&](int64_t y, int64_t z, int64_t x0, int64_t x1) {
      rows.push_back({y, z, x0, x1});
    });
    return rows;
  };
  const auto expected = voxels(a, b, b);
  EXPECT_FALSE(expected.empty());
  EXPECT_EQ(voxels(a, b, between), expected);
  EXPECT_EQ(voxels(a, between, b), expected);
  EXPECT_EQ(voxels(between, a, b), expected);
}

TEST(TriangleSetupTest, DominantAxisTiesGoToXThenY) {
  EXPECT_EQ(DominantAxis(Vec3d{1, -1, 1}), 0);
  EXPECT_EQ(DominantAxis(Vec3d{0, -1, 1}), 1);
  EXPECT_EQ(DominantAxis(Vec3d{0.5, 0.5, -1}), 2);
}

// Bounds made by four, each its part, are those that one makes: to the last bit, and nothing of them is left out.
TEST(TriangleSetupTest, PartsMakeTheSameBounds) {
  struct PartOfSetup {
    BoundsPart<float> narrow;
    BoundsPart<double> wide;
    SpanClass span_class;
    Vec3d base, box_first, box_last;
  };
  int classes[3] = {0, 0, 0};
  for (const double extent : {3.0, 50.0, 4000.0}) {
    const TriangleMesh soup = Soup(300, extent, 7);
    for (const auto& t : soup.triangles) {
      const Vec3d &a = soup.positions[t[0]], &b = soup.positions[t[1]], &c = soup.positions[t[2]];
      for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter}) {
        const TriangleSetup whole = SetUpTriangle(a, b, c, coverage);
        SpanBounds<float> narrow;
        SpanBounds<double> wide;
        std::memset(static_cast<void*>(&narrow), 0xff, sizeof narrow);
        std::memset(static_cast<void*>(&wide), 0xff, sizeof wide);
        for (int part = 0; part < kBoundsParts; ++part) {
          PartOfSetup s{{narrow, part, {}, {}}, {wide, part, {}, {}}, SpanClass::kRun, {}, {}, {}};
          SetUpTriangle(a, b, c, coverage, s);
          ASSERT_EQ(s.span_class, whole.span_class);
          ASSERT_EQ(s.base, whole.base);
          ASSERT_EQ(s.box_first, whole.box_first);
          ASSERT_EQ(s.box_last, whole.box_last);
        }
        ++classes[int(whole.span_class)];
        const bool is_narrow = whole.span_class == SpanClass::kNarrow, is_wide = whole.span_class == SpanClass::kWide;
        ASSERT_TRUE(!is_narrow || std::memcmp(&narrow, &whole.narrow, sizeof narrow) == 0);
        ASSERT_TRUE(!is_wide || std::memcmp(&wide, &whole.wide, sizeof wide) == 0);
      }
    }
  }
  for (const int count : classes) EXPECT_GT(count, 0);
}

TEST(SpansTest, FarTrianglesAreClampedNotConverted) {
  const VoxelRange all{{0, 0, 0}, {4, 4, 4}};
  const double far = 0x1p40;
  int64_t voxels = 0;
  // A plane z = 1.5 far beyond the grid on every side.
  ForEachRowSpan(SetUpTriangle({-far, -far, 1.5}, {far, -far, 1.5}, {0, far, 1.5}, Coverage::kConservative), all,
                 [&](int64_t, int64_t, int64_t x0, int64_t x1) { voxels += x1 - x0; });
  EXPECT_GE(voxels, 16);
  EXPECT_LE(voxels, 48);  // nothing is missed; the widening of so large a triangle may add its neighbours
  voxels = 0;
  ForEachRowSpan(SetUpTriangle({far, far, far}, {far - 8, far, far}, {far, far - 8, far}, Coverage::kConservative), all,
                 [&](int64_t, int64_t, int64_t x0, int64_t x1) { voxels += x1 - x0; });
  EXPECT_EQ(voxels, 0);
}

TEST(SpansTest, BarycentricsOfTheCentre) {
  const TrianglePlane s = SetUpPlane({0, 0, 0.25}, {8, 0, 0.25}, {0, 8, 0.25});
  const Vec3f inside = Barycentrics(s, 1, 3, 0);  // centre (1.5, 3.5)
  EXPECT_FLOAT_EQ(inside.y, 1.5f / 8);
  EXPECT_FLOAT_EQ(inside.z, 3.5f / 8);
  EXPECT_FLOAT_EQ(inside.x, 3.0f / 8);
  const Vec3f outside = Barycentrics(s, 7, 1, 0);  // (7.5, 1.5) lies beyond the long edge: -1/8, 7.5/8, 1.5/8
  EXPECT_EQ(outside.x, 0);
  EXPECT_FLOAT_EQ(outside.y, 7.5f / 9);
  EXPECT_FLOAT_EQ(outside.z, 1.5f / 9);
  const Vec3f third = Barycentrics(SetUpPlane({0, 0, 0}, {1, 1, 1}, {2, 2, 2}), 0, 0, 0);
  EXPECT_EQ(third, (Vec3f{1.0f / 3, 1.0f / 3, 1.0f / 3}));
}

// Every tile that holds a touched voxel is among the tiles of the binning.
TEST(TilesTest, BinningMissesNoTile) {
  const int64_t dims[3] = {70, 33, 41};
  const TileGrid tiles = TilesOf(dims);
  EXPECT_EQ(tiles.count(), 3u * 5 * 6);
  const TriangleMesh soup = Soup(400, 50, 21);
  for (const auto& t : soup.triangles) {
    const Vec3d &a = soup.positions[t[0]], &b = soup.positions[t[1]], &c = soup.positions[t[2]];
    std::vector<int> binned(tiles.count());
    ForEachTile(tiles, a, b, c, [&](uint64_t tile) {
      ASSERT_LT(tile, tiles.count());
      EXPECT_EQ(binned[tile]++, 0) << "emitted twice";
    });
    const VoxelRange all{{0, 0, 0}, {dims[0], dims[1], dims[2]}};
    ForEachRowSpan(SetUpTriangle(a, b, c, Coverage::kConservative), all,
                   [&](int64_t y, int64_t z, int64_t x0, int64_t x1) {
                     for (int64_t x = x0; x < x1; ++x) ASSERT_EQ(binned[tiles.Index(x / 32, y / 8, z / 8)], 1);
                   });
  }
}

TEST(TilesTest, TileVoxelsAreClippedToTheGrid) {
  const int64_t dims[3] = {33, 8, 9};
  const TileGrid tiles = TilesOf(dims);
  const VoxelRange last = TileVoxels(tiles, tiles.count() - 1, dims);
  EXPECT_EQ(last.begin[0], 32);
  EXPECT_EQ(last.end[0], 33);
  EXPECT_EQ(last.begin[2], 8);
  EXPECT_EQ(last.end[2], 9);
}

TEST(CrossingTest, NeighboursAgreeOnTheirEdge) {
  // A fan around a point on a column's centre: exactly one of its triangles is crossed.
  const Vec3d hub{3, 2.5, 2.5};
  int crossings = 0;
  for (int i = 0; i < 12; ++i) {
    const auto rim = [&](int k) {
      const double angle = 2 * 3.141592653589793 * (k % 12) / 12;
      return Vec3d{3, 2.5 + 2 * std::cos(angle), 2.5 + 2 * std::sin(angle)};
    };
    crossings += LineCrosses(hub, rim(i), rim(i + 1), 2.5, 2.5);
  }
  EXPECT_EQ(crossings, 1);
}

TEST(CrossingTest, TogglesTheCentresBefore) {
  EXPECT_EQ(CentresBefore(-5, 8), 0);
  EXPECT_EQ(CentresBefore(0.5, 8), 0);  // a crossing exactly at a centre is not beyond it
  EXPECT_EQ(CentresBefore(0.5000001, 8), 1);
  EXPECT_EQ(CentresBefore(3, 8), 3);
  EXPECT_EQ(CentresBefore(1e30, 8), 8);
}

}  // namespace
}  // namespace voxelpipe
