// What a sample of the triangles says of a mesh, against a look at all of them.
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "gtest/gtest.h"
#include "mesh/content_id.h"
#include "pipeline/plan/surface.h"
#include "pipeline/stages/backend.h"
#include "support/meshes/meshes.h"
#include "support/run.h"
#include "unit/pipeline/plan/measured_surface.h"

namespace voxelpipe {
namespace {

using testing::FloatTarget;
using testing::MakeMesh;
using testing::MeasuredSurface;
using testing::RunPipeline;
using testing::TargetOf;
using testing::UnitGrid;

// Triangles that share no vertices.
TriangleMesh Loose(const std::vector<std::array<Vec3d, 3>>& triangles) {
  std::vector<Vec3d> positions;
  std::vector<std::array<uint32_t, 3>> ids;
  for (const auto& t : triangles) {
    const auto v = uint32_t(positions.size());
    positions.insert(positions.end(), t.begin(), t.end());
    ids.push_back({v, v + 1, v + 2});
  }
  return MakeMesh(std::move(positions), std::move(ids));
}

class Dice {
 public:
  double operator()(double low, double high) { return low + (high - low) * double(engine_() >> 11) * 0x1p-53; }
  Vec3d Point(double low, double high) {
    const double x = (*this)(low, high), y = (*this)(low, high), z = (*this)(low, high);
    return {x, y, z};
  }

 private:
  std::mt19937_64 engine_{1};
};

// A parallelogram of n x n parts of two triangles, with bumps.
std::vector<std::array<Vec3d, 3>> Sheet(const Vec3d& corner, const Vec3d& u, const Vec3d& v, int n, Dice& dice) {
  std::vector<Vec3d> at;
  const double bump = 0.1 * std::sqrt(Dot(u, u)) / n;
  for (int i = 0; i < (n + 1) * (n + 1); ++i) {
    at.push_back(corner + u * (double(i % (n + 1)) / n) + v * (double(i / (n + 1)) / n) + dice.Point(-bump, bump));
  }
  std::vector<std::array<Vec3d, 3>> out;
  for (int y = 0; y < n; ++y) {
    for (int x = 0; x < n; ++x) {
      const Vec3d* const p = &at[size_t(x + y * (n + 1))];
      out.push_back({p[0], p[1], p[n + 1]});
      out.push_back({p[1], p[n + 2], p[n + 1]});
    }
  }
  return out;
}

struct Case {
  std::string name;
  TriangleMesh mesh;
  GridRequest grid;
  bool sampled = true;  // otherwise a sample may have too little to say
};

GridRequest Resolution(int64_t n) {
  GridRequest grid;
  grid.resolution = n;
  return grid;
}

std::vector<Case> Cases() {
  std::vector<Case> cases;
  for (const int n : {60, 200, 400}) {
    for (const int64_t resolution : {60, 200, 400}) {
      cases.push_back({absl::StrCat("torus ", n, " at ", resolution), testing::Torus(n), Resolution(resolution)});
    }
  }
  for (const int64_t resolution : {60, 300}) {
    cases.push_back(
        {absl::StrCat("bumpy at ", resolution), testing::BumpySphere(100, 3), Resolution(resolution), false});
    cases.push_back({absl::StrCat("soup at ", resolution), testing::Soup(30'000, double(resolution), 5),
                     UnitGrid(resolution, resolution, resolution), false});
  }
  TriangleMesh ten = testing::Torus(80);
  const auto once = ten.triangles;
  for (int i = 0; i < 9; ++i) ten.triangles.insert(ten.triangles.end(), once.begin(), once.end());
  ten.parts[0].triangle_count = ten.triangles.size();
  cases.push_back({"ten in one", ten, Resolution(200), false});
  // A tenth of the surface twenty times.
  TriangleMesh part = testing::Torus(200);
  const std::vector tenth(part.triangles.begin(), part.triangles.begin() + ptrdiff_t(part.triangles.size() / 10));
  for (int i = 0; i < 19; ++i) part.triangles.insert(part.triangles.end(), tenth.begin(), tenth.end());
  part.parts[0].triangle_count = part.triangles.size();
  cases.push_back({"a part twenty times", part, Resolution(300), false});
  Dice dice;
  std::vector<std::array<Vec3d, 3>> slivers, points, scene, window;
  for (int i = 0; i < 20'000; ++i) {
    const Vec3d a = dice.Point(0, 200), b = dice.Point(0, 200);
    slivers.push_back({a, b, a + dice.Point(-0.01, 0.01)});
    const Vec3d p{std::floor(dice(0, 6)) * 8, std::floor(dice(0, 6)) * 8, std::floor(dice(0, 6)) * 8};
    points.push_back({p, p, p});
  }
  // A thousand walls among details: a sample of all triangles alike would see few of them.
  for (int i = 0; i < 400'000; ++i) {
    const Vec3d p = dice.Point(0, 60);
    scene.push_back({p, p + dice.Point(-0.3, 0.3), p + dice.Point(-0.3, 0.3)});
    if (i % 20'000 == 0) scene.push_back({Vec3d{0, double(i) / 2000, 0}, {256, double(i) / 2000, 0}, {0, 30, 256}});
    const Vec3d q = dice.Point(0, 1000);
    window.push_back({q, q + dice.Point(-2, 2), q + dice.Point(-2, 2)});
  }
  cases.push_back({"slivers", Loose(slivers), UnitGrid(200, 200, 200), false});
  cases.push_back({"points", Loose(points), UnitGrid(60, 60, 60)});
  cases.push_back({"scene", Loose(scene), UnitGrid(256, 256, 256)});
  cases.push_back({"window", Loose(window), UnitGrid(300, 200, 100), false});
  // A room and in it a statue: a few voxels have most of the triangles, and nearly all that the sample sees twice.
  // A room and in it a statue: a few voxels have most of the triangles, and nearly all that a sample sees twice.
  std::vector<std::array<Vec3d, 3>> room = Sheet({0, 0, 8}, {600, 0, 20}, {0, 600, 30}, 300, dice);
  for (const auto& t : Sheet({100, 100, 80}, {60, 0, 5}, {0, 60, 3}, 400, dice)) room.push_back(t);
  cases.push_back({"room with a statue", Loose(room), UnitGrid(640, 640, 128)});
  // Dust instead of the room.
  std::vector<std::array<Vec3d, 3>> dust = Sheet({100, 100, 80}, {60, 0, 5}, {0, 60, 3}, 400, dice);
  for (int i = 0; i < 40'000; ++i) {
    const Vec3d p = dice.Point(0, 600);
    dust.push_back({p, p + dice.Point(-0.01, 0.01), p + dice.Point(-0.01, 0.01)});
  }
  cases.push_back({"dust with a statue", Loose(dust), UnitGrid(600, 600, 600), false});
  // Large triangles in one place, among details.
  std::vector<std::array<Vec3d, 3>> walls(scene.begin() + 1, scene.begin() + 10'000);
  for (int i = 0; i < 300; ++i) walls.push_back({Vec3d{30, 40, 50}, {130, 50, 60}, {60, 140, 150}});
  cases.push_back({"walls in one place", Loose(walls), UnitGrid(256, 256, 256), false});
  return cases;
}

// `some` within a factor of `all`.
void ExpectAbout(double some, double all, double factor, const std::string& what, double few = 1000) {
  EXPECT_LE(some, factor * all + few) << what;
  EXPECT_GE(some * factor + few, all) << what;
}

TEST(SampleTest, SaysAboutWhatALookAtAllTrianglesSays) {
  for (const Case& c : Cases()) {
    for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter}) {
      VoxelizeRequest request;
      request.grid = c.grid;
      request.coverage = coverage;
      const double voxels = double(RunPipeline(c.mesh, request).stats.occupied);
      request.result = ResultKind::kSparse;
      request.targets = {FloatTarget(4, Blend::kReplace, {"position", {}})};
      const Surface some = MeasuredSurface(c.mesh, request, false), all = MeasuredSurface(c.mesh, request, true);
      const std::string what = absl::StrCat(c.name, " ", std::string(Name(coverage)));
      EXPECT_FALSE(c.sampled && some.closely) << what;
      ExpectAbout(some.fragments, all.fragments, 1.2, what + ", fragments");
      ExpectAbout(some.rows, all.rows, 1.2, what + ", rows");
      ExpectAbout(some.pairs, all.pairs, 1.1, what + ", pairs");
      ExpectAbout(some.layers, all.layers, 1.1, what + ", layers");
      ExpectAbout(some.crossings, all.crossings, 1.1, what + ", crossings");
      ExpectAbout(some.voxels, voxels, 1.6, what + ", voxels");
      ExpectAbout(some.bricks, all.bricks, 1.5, what + ", bricks");
    }
  }
}

TEST(SampleTest, OfADenseResultSaysWhatMemoryIsTakenFor) {
  for (const Case& c : Cases()) {
    VoxelizeRequest request;
    request.grid = c.grid;
    request.fill = Fill::kParity;
    request.targets = {FloatTarget(1, Blend::kMax, {"occupancy", {}})};
    const Surface some = MeasuredSurface(c.mesh, request, false), all = MeasuredSurface(c.mesh, request, true);
    ExpectAbout(some.pairs, all.pairs, 1.25, c.name + ", pairs", 10'000);
    ExpectAbout(some.crossings, all.crossings, 1.25, c.name + ", crossings");
    EXPECT_GE(some.layers * 1.25, all.layers) << c.name;
  }
}

// A flood keeps the conservative shell, whatever the coverage: of large triangles, too.
TEST(SampleTest, OfAFloodCountsTheShellOfLargeTriangles) {
  Dice dice;
  std::vector<std::array<Vec3d, 3>> walls = Sheet({10, 10, 10}, {20, 0, 3}, {0, 20, 2}, 70, dice);
  for (int i = 0; i < 15; ++i) {
    const double z = 16.0 * i;
    walls.push_back({Vec3d{0, 0, z}, {250, 0, z + 120}, {0, 250, z + 130}});
  }
  const TriangleMesh mesh = Loose(walls);
  for (const Coverage coverage : {Coverage::kThin, Coverage::kCenter}) {
    VoxelizeRequest request;
    request.grid = UnitGrid(256, 256, 512);
    request.result = ResultKind::kSparse;
    request.coverage = coverage;
    request.fill = Fill::kFlood;
    const Surface some = MeasuredSurface(mesh, request, false), all = MeasuredSurface(mesh, request, true);
    const std::string what(Name(coverage));
    EXPECT_FALSE(some.closely) << what;
    ExpectAbout(some.inside, all.inside, 1.25, what + ", inside");
  }
}

TEST(SampleTest, OfVoxelsAlmostAsSmallAsNumbersCanBeLooksAtAllTriangles) {
  TriangleMesh mesh = testing::Torus(80);
  for (Vec3d& p : mesh.positions) p = {p.x * 1e-307, p.y * 1e-307, 0};
  VoxelizeRequest request;
  request.grid.resolution = 100;
  request.result = ResultKind::kSparse;
  EXPECT_TRUE(MeasuredSurface(mesh, request, false).closely);
}

TEST(SampleTest, IsTheSameForAnyNumberOfThreads) {
  const TriangleMesh mesh = testing::Torus(200);
  VoxelizeRequest request;
  request.grid.resolution = 200;
  request.result = ResultKind::kBuckets;
  request.threads = 1;
  const Surface one = MeasuredSurface(mesh, request, false);
  request.threads = 4;
  const Surface four = MeasuredSurface(mesh, request, false);
  EXPECT_EQ(one.fragments, four.fragments);
  EXPECT_EQ(one.rows, four.rows);
  EXPECT_EQ(one.voxels, four.voxels);
  EXPECT_EQ(one.bricks, four.bricks);
}

// What has the same content_id has the same arrays, or so its maker says.
TEST(KeptSurfacesTest, AMeshThatIsKeptIsMeasuredOnceAGrid) {
  VoxelizeRequest request;
  request.grid = UnitGrid(64, 64, 64);
  request.result = ResultKind::kBuckets;
  TriangleMesh large = testing::Torus(20), small = testing::Torus(10);
  for (Vec3d& p : large.positions) p = (p + Vec3d{2, 2, 2}) * 15.0;
  for (Vec3d& p : small.positions) p = (p + Vec3d{2, 2, 2}) * 5.0;
  const double of_large = MeasuredSurface(large, request, true).fragments,
               of_small = MeasuredSurface(small, request, true).fragments;
  ASSERT_GT(of_large, of_small);
  large.content_id = small.content_id = "kept by this test";
  EXPECT_EQ(MeasuredSurface(large, request, true).fragments, of_large);
  EXPECT_EQ(MeasuredSurface(small, request, true).fragments, of_large);
  request.coverage = Coverage::kThin;
  EXPECT_LT(MeasuredSurface(small, request, true).fragments, of_small);
  request.coverage = Coverage::kConservative;
  request.grid = UnitGrid(64, 64, 65);
  EXPECT_EQ(MeasuredSurface(small, request, true).fragments, of_small);
  request.grid = UnitGrid(64, 64, 64);
  request.vertex_shader = {"transform", {}};
  EXPECT_EQ(MeasuredSurface(small, request, true).fragments, of_small);
  request.vertex_shader = {"identity", {}};
  EXPECT_EQ(MeasuredSurface(small, request, true).fragments, of_large);
  small.content_id = large.content_id = NewMovedId(large.content_id);
  EXPECT_EQ(MeasuredSurface(large, request, true).fragments, of_large);
  EXPECT_EQ(MeasuredSurface(small, request, true).fragments, of_small);
  small.content_id.clear();
  EXPECT_EQ(MeasuredSurface(small, request, true).fragments, of_small);
}

// Bits of occupancy need no tiles, and their layers are not measured; others of as many bytes do.
TEST(KeptSurfacesTest, BitsOfShadersAreMeasuredOfTheirOwn) {
  TriangleMesh mesh = testing::Torus(20);
  for (Vec3d& p : mesh.positions) p = (p + Vec3d{2, 2, 2}) * 15.0;
  VoxelizeRequest request;
  request.grid = UnitGrid(64, 64, 64);
  TargetSpec target = TargetOf(VoxelFormat::kBit, 1, Blend::kOr, {"base_color", {}});
  request.targets = {target};
  const double layers = MeasuredSurface(mesh, request, false).layers;
  target.shader = {"occupancy", {}};
  mesh.content_id = "its bits are kept by this test";
  request.targets = {target};
  ASSERT_NE(MeasuredSurface(mesh, request, false).layers, layers);
  target.shader = {"base_color", {}};
  request.targets = {target};
  EXPECT_EQ(MeasuredSurface(mesh, request, false).layers, layers);
}

}  // namespace
}  // namespace voxelpipe
