#include "load/base/polygons.h"

#include <cmath>
#include <numbers>
#include <numeric>
#include <random>

#include "absl/strings/str_cat.h"
#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "support/warnings.h"
#include "unit/load/text_mesh.h"

namespace voxelpipe {
namespace {

using ::testing::ElementsAre;
using testing::ErrorOf;
using ::testing::IsEmpty;
using testing::LoadText;
using Point = std::pair<double, double>;
using Triangles = std::vector<std::array<uint32_t, 3>>;

// A polygon in a plane of z = x / 4 + 1, so that it faces no axis exactly.
class PolygonsTest : public ::testing::Test {
 protected:
  PolygonsTest() : budget_(job_, limits_, "TEST"), polygons_(budget_) {}

  // The triangles of the polygon that begins at corner `first`, as numbers of points.
  Triangles Of(const std::vector<Point>& points, uint32_t first = 0) {
    Primitive out;
    std::vector<uint32_t> corners;
    for (uint32_t i = 0; i < points.size(); ++i) {
      out.positions.push_back({float(points[i].first), float(points[i].second), float(points[i].first / 4 + 1)});
      corners.push_back(uint32_t((first + i) % points.size()));
    }
    EXPECT_TRUE(polygons_.Add(corners, out).ok());
    return out.triangles;
  }

  static double Area(const Point& a, const Point& b, const Point& c) {
    return ((b.first - a.first) * (c.second - a.second) - (b.second - a.second) * (c.first - a.first)) / 2;
  }
  // A polygon that does not cross itself is covered, and nothing else, if all triangles turn as it does and their areas
  // add up to its own.
  void ExpectCovered(const std::vector<Point>& points, const Triangles& triangles) {
    double area = 0, sum = 0;
    for (size_t i = 0; i < points.size(); ++i) area += Area({0, 0}, points[i], points[(i + 1) % points.size()]);
    const double turn = area < 0 ? -1 : 1;
    for (const auto& [a, b, c] : triangles) {
      const double part = turn * Area(points[a], points[b], points[c]);
      EXPECT_GE(part, -1e-6 * std::abs(area)) << a << " " << b << " " << c;
      sum += part;
    }
    EXPECT_NEAR(sum, turn * area, 1e-6 * std::abs(area));
    EXPECT_EQ(triangles.size(), points.size() - 2);
  }

  std::vector<std::string> Warnings() {
    WarningList warnings;
    polygons_.Finish(warnings);
    return testing::Lines(warnings);
  }

  const JobContext job_;
  const LoadLimits limits_;
  LoadBudget budget_;
  Polygons polygons_;
};

TEST_F(PolygonsTest, ConvexOnesStayFansFromTheirFirstCorner) {
  EXPECT_THAT(Of({{0, 0}, {4, 0}, {4, 3}, {0, 3}}, 2),
              ElementsAre(std::array<uint32_t, 3>{2, 3, 0}, std::array<uint32_t, 3>{2, 0, 1}));
  // Corners on the edges, and rounded to floats: a circle of many corners.
  std::vector<Point> circle;
  for (int i = 0; i < 5000; ++i) {
    const double angle = 2 * std::numbers::pi * i / 5000;
    circle.emplace_back(1000.1 + std::cos(angle), 77.7 + std::sin(angle));
  }
  const Triangles fan = Of(circle);
  for (uint32_t i = 0; i < fan.size(); ++i) ASSERT_EQ(fan[i], (std::array<uint32_t, 3>{0, i + 1, i + 2}));
  EXPECT_EQ(Of({{0, 0}, {1, 0}, {2, 0}, {2, 2}, {1, 2}, {0, 2}})[0], (std::array<uint32_t, 3>{0, 1, 2}));
  EXPECT_THAT(Warnings(), IsEmpty());
}

TEST_F(PolygonsTest, AFanThatIsRightStays) {
  const std::vector<Point> dart = {{0, 0}, {4, -3}, {2, 0}, {4, 3}};  // concave at its third corner
  EXPECT_THAT(Of(dart), ElementsAre(std::array<uint32_t, 3>{0, 1, 2}, std::array<uint32_t, 3>{0, 2, 3}));
}

TEST_F(PolygonsTest, ConcaveOnesAreCoveredWhateverTheirFirstCorner) {
  const std::vector<std::vector<Point>> shapes = {
      {{0, 0}, {4, -3}, {2, 0}, {4, 3}},                                                                 // a dart
      {{0, 0}, {9, 0}, {9, 9}, {6, 9}, {6, 3}, {3, 3}, {3, 9}, {0, 9}},                                  // a U
      {{0, 0}, {5, 0}, {5, 1}, {1, 1}, {1, 4}, {4, 4}, {4, 3}, {2, 3}, {2, 2}, {5, 2}, {5, 5}, {0, 5}},  // a spiral
      {{0, 0}, {3, 0}, {6, 0}, {6, 3}, {6, 6}, {5, 3}, {4, 6}, {3, 3}, {2, 6}, {1, 3}, {0, 6}, {0, 3}},  // a comb
      // A square hole, reached by a bridge of two edges.
      {{0, 0}, {9, 0}, {9, 9}, {0, 9}, {0, 0}, {3, 3}, {3, 6}, {6, 6}, {6, 3}, {3, 3}},
  };
  for (const std::vector<Point>& shape : shapes) {
    std::vector<Point> turned(shape.rbegin(), shape.rend());
    for (uint32_t first = 0; first < shape.size(); ++first) {
      SCOPED_TRACE(absl::StrCat(shape.size(), " corners from ", first));
      ExpectCovered(shape, Of(shape, first));
      ExpectCovered(turned, Of(turned, first));
    }
  }
  EXPECT_THAT(Warnings(), IsEmpty());
}

TEST_F(PolygonsTest, RandomStarsOfManyCornersAreCovered) {
  std::mt19937 random(1);
  for (const int count : {5, 8, 20, 100, 3000}) {
    for (int round = 0; round < 20; ++round) {
      std::vector<Point> star;
      for (int i = 0; i < count; ++i) {
        const double angle = 2 * std::numbers::pi * i / count, radius = double(1 + random() % 100);
        star.emplace_back(float(radius * std::cos(angle)), float(radius * std::sin(angle)));
      }
      SCOPED_TRACE(absl::StrCat(count, " corners, round ", round));
      ExpectCovered(star, Of(star, uint32_t(random()) % uint32_t(count)));
    }
  }
  EXPECT_THAT(Warnings(), IsEmpty());
}

// A zigzag as wide as one of its 50,000 steps: no corner sees much of it, and its ears are long.
TEST_F(PolygonsTest, OutlinesOfAHundredThousandCornersAreCovered) {
  std::vector<Point> outline;
  constexpr int kTeeth = 25'000;
  for (int i = 0; i < kTeeth; ++i) {
    outline.emplace_back(2 * i, 0);
    outline.emplace_back(2 * i + 1, 100);
  }
  for (int i = kTeeth; i-- > 0;) {
    outline.emplace_back(2 * i + 1, 101);
    outline.emplace_back(2 * i, 1);
  }
  ExpectCovered(outline, Of(outline, 17));
  EXPECT_THAT(Warnings(), IsEmpty());
}

TEST_F(PolygonsTest, OnesThatCrossThemselvesAreFansAndSaidToBe) {
  EXPECT_THAT(Of({{0, 0}, {4, 4}, {4, 0}, {0, 3}}),
              ElementsAre(std::array<uint32_t, 3>{0, 1, 2}, std::array<uint32_t, 3>{0, 2, 3}));
  EXPECT_THAT(Warnings(), ElementsAre(::testing::HasSubstr("1 concave faces cross themselves")));
}

// All spikes meet in the middle, so that each ear has all others before it.
TEST_F(PolygonsTest, TheWorkIsBoundedByTheCorners) {
  std::vector<Point> spikes;
  std::mt19937 random(2);
  for (int i = 0; i < 200'000; ++i) spikes.emplace_back(double(random() % 1000), double(random() % 1000));
  EXPECT_EQ(Of(spikes).size(), spikes.size() - 2);  // it crosses itself everywhere
  EXPECT_EQ(Warnings().size(), 1u);
}

TEST_F(PolygonsTest, FlatAndRepeatedCornersAreHarmless) {
  EXPECT_EQ(Of({{1, 1}, {1, 1}, {1, 1}, {1, 1}}).size(), 2u);
  EXPECT_EQ(Of({{0, 0}, {1, 0}, {2, 0}, {3, 0}, {1, 0}}).size(), 3u);
  const std::vector<Point> doubled = {{0, 0}, {0, 0}, {9, 0}, {9, 9}, {9, 9}, {4, 2}, {4, 2}, {0, 9}};
  for (uint32_t first = 0; first < doubled.size(); ++first) ExpectCovered(doubled, Of(doubled, first));
}

TEST_F(PolygonsTest, AFileEndsWithItsJob) {
  std::vector<uint32_t> corners(1 << 20);
  std::iota(corners.begin(), corners.end(), 0);
  Primitive out;
  for (const uint32_t i : corners) out.positions.push_back({float(i), float(i * 37 % 1000), 0});
  JobContext job;
  job.Cancel();
  LoadBudget budget(job, limits_, "TEST");
  Polygons polygons(budget);
  EXPECT_EQ(polygons.Add(corners, out).code(), absl::StatusCode::kCancelled);
}

// The letter L from each of its corners, as every format writes it.
TEST(ConcaveFaces, AreTheSameInEveryFormatThatHasPolygons) {
  const std::vector<std::array<int, 2>> points = {{0, 0}, {3, 0}, {3, 1}, {1, 1}, {1, 3}, {0, 3}};
  for (size_t first = 0; first < points.size(); ++first) {
    std::string vertices, obj, list;
    for (size_t i = 0; i < points.size(); ++i) {
      const auto& p = points[(first + i) % points.size()];
      absl::StrAppend(&vertices, p[0], " ", p[1], " 0\n");
      absl::StrAppend(&obj, "v ", p[0], " ", p[1], " 0\n");
      absl::StrAppend(&list, " ", i);
    }
    const std::string ply =
        "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\n"
        "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n";
    for (const std::string& text :
         {obj + "f 1 2 3 4 5 6\n", "OFF\n6 1 0\n" + vertices + "6" + list + "\n", ply + vertices + "6" + list + "\n"}) {
      const absl::StatusOr<Scene> scene = LoadText(text);
      ASSERT_TRUE(scene.ok()) << scene.status();
      double area = 0;
      const std::vector<Vec3f> corners = testing::CornersOf(*scene);
      ASSERT_EQ(corners.size(), 12u);
      for (size_t t = 0; t < corners.size(); t += 3) {
        const Vec3f a = corners[t + 1] - corners[t], b = corners[t + 2] - corners[t];
        EXPECT_GE(Cross(a, b).z, 0) << text;
        area += Cross(a, b).z / 2;
      }
      EXPECT_EQ(area, 5) << text;
    }
  }
}

}  // namespace
}  // namespace voxelpipe
