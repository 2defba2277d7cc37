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
#include "pipeline/stages/bind.h"
#include "pipeline/stages/stages.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using testing::FloatTarget;
using testing::MakeMesh;
using testing::RunPipeline;
using testing::TargetOf;
using testing::UnitGrid;

Surface Measure(const TriangleMesh& mesh, const VoxelizeRequest& request, bool closely) {
  const Backend& cpu = **SelectBackend(BackendChoice::kCpu);
  const BoundRequest bound = *BindRequest(JobContext(), mesh, request);
  const JobContext job;
  absl::StatusOr<Surface> surface = absl::UnknownError("not run");
  cpu.Run(request.threads, [&] {
    auto stages = cpu.Start(mesh, bound, job);
    const absl::StatusOr<MeshExtent> extent = (*stages)->VertexShade();
    const MeshSize size{mesh.triangles.size(), mesh.positions.size(), *extent};
    surface = (*stages)->Measure(*FitGrid(request.grid, extent->box), size, closely);
  });
  EXPECT_TRUE(surface.ok()) << surface.status();
  return *surface;
}

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

struct Case {
  std::string name;
  TriangleMesh mesh;
  GridRequest grid;
  bool closely = false;  // a sample has too little to say
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
    cases.push_back({absl::StrCat("bumpy at ", resolution), testing::BumpySphere(100, 3), Resolution(resolution)});
    cases.push_back({absl::StrCat("soup at ", resolution), testing::Soup(30'000, double(resolution), 5),
                     UnitGrid(resolution, resolution, resolution), resolution == 300});
  }
  TriangleMesh ten = testing::Torus(80);
  const auto once = ten.triangles;
  for (int i = 0; i < 9; ++i) ten.triangles.insert(ten.triangles.end(), once.begin(), once.end());
  ten.parts[0].triangle_count = ten.triangles.size();
  cases.push_back({"ten in one", ten, Resolution(200)});
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
    const Vec3d p = dice.Point(0, 20);
    scene.push_back({p, p + dice.Point(-0.3, 0.3), p + dice.Point(-0.3, 0.3)});
    if (i % 20'000 == 0) scene.push_back({Vec3d{0, double(i) / 2000, 0}, {256, double(i) / 2000, 0}, {0, 30, 256}});
    const Vec3d q = dice.Point(0, 1000);
    window.push_back({q, q + dice.Point(-2, 2), q + dice.Point(-2, 2)});
  }
  cases.push_back({"slivers", Loose(slivers), UnitGrid(200, 200, 200), true});
  cases.push_back({"points", Loose(points), UnitGrid(60, 60, 60)});
  cases.push_back({"scene", Loose(scene), UnitGrid(256, 256, 256)});
  cases.push_back({"window", Loose(window), UnitGrid(300, 200, 100), true});
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
      const Surface some = Measure(c.mesh, request, false), all = Measure(c.mesh, request, true);
      const std::string what = absl::StrCat(c.name, " ", std::string(Name(coverage)));
      EXPECT_EQ(some.closely, c.closely) << what;
      ExpectAbout(some.fragments, all.fragments, 1.2, what + ", fragments");
      ExpectAbout(some.rows, all.rows, 1.2, what + ", rows");
      ExpectAbout(some.pairs, all.pairs, 1.1, what + ", pairs");
      ExpectAbout(some.layers, all.layers, 1.1, what + ", layers");
      ExpectAbout(some.crossings, all.crossings, 1.1, what + ", crossings");
      ExpectAbout(some.voxels, voxels, 1.6, what + ", voxels");
      ExpectAbout(some.bricks, all.bricks, 1.4, what + ", bricks");
    }
  }
}

TEST(SampleTest, OfADenseResultSaysWhatMemoryIsTakenFor) {
  for (const Case& c : Cases()) {
    VoxelizeRequest request;
    request.grid = c.grid;
    request.fill = Fill::kParity;
    request.targets = {FloatTarget(1, Blend::kMax, {"occupancy", {}})};
    const Surface some = Measure(c.mesh, request, false), all = Measure(c.mesh, request, true);
    ExpectAbout(some.pairs, all.pairs, 1.25, c.name + ", pairs", 10'000);
    ExpectAbout(some.crossings, all.crossings, 1.25, c.name + ", crossings");
    EXPECT_GE(some.layers * 1.25, all.layers) << c.name;
  }
}

TEST(SampleTest, IsTheSameForAnyNumberOfThreads) {
  const TriangleMesh mesh = testing::Torus(200);
  VoxelizeRequest request;
  request.grid.resolution = 200;
  request.result = ResultKind::kBuckets;
  request.threads = 1;
  const Surface one = Measure(mesh, request, false);
  request.threads = 4;
  const Surface four = Measure(mesh, request, false);
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
  const double of_large = Measure(large, request, true).fragments, of_small = Measure(small, request, true).fragments;
  ASSERT_GT(of_large, of_small);
  large.content_id = small.content_id = "kept by this test";
  EXPECT_EQ(Measure(large, request, true).fragments, of_large);
  EXPECT_EQ(Measure(small, request, true).fragments, of_large);
  request.coverage = Coverage::kThin;
  EXPECT_LT(Measure(small, request, true).fragments, of_small);
  request.coverage = Coverage::kConservative;
  request.grid = UnitGrid(64, 64, 65);
  EXPECT_EQ(Measure(small, request, true).fragments, of_small);
  request.grid = UnitGrid(64, 64, 64);
  request.vertex_shader = {"transform", {}};
  EXPECT_EQ(Measure(small, request, true).fragments, of_small);
  request.vertex_shader = {"identity", {}};
  EXPECT_EQ(Measure(small, request, true).fragments, of_large);
  small.content_id = large.content_id = NewMovedId(large.content_id);
  EXPECT_EQ(Measure(large, request, true).fragments, of_large);
  EXPECT_EQ(Measure(small, request, true).fragments, of_small);
  small.content_id.clear();
  EXPECT_EQ(Measure(small, request, true).fragments, of_small);
}

// Bits of occupancy need no tiles, and their layers are not measured; others of as many bytes do.
TEST(KeptSurfacesTest, BitsOfShadersAreMeasuredOfTheirOwn) {
  TriangleMesh mesh = testing::Torus(20);
  for (Vec3d& p : mesh.positions) p = (p + Vec3d{2, 2, 2}) * 15.0;
  VoxelizeRequest request;
  request.grid = UnitGrid(64, 64, 64);
  TargetSpec target = TargetOf(VoxelFormat::kBit, 1, Blend::kOr, {"base_color", {}});
  request.targets = {target};
  const double layers = Measure(mesh, request, false).layers;
  target.shader = {"occupancy", {}};
  mesh.content_id = "its bits are kept by this test";
  request.targets = {target};
  ASSERT_NE(Measure(mesh, request, false).layers, layers);
  target.shader = {"base_color", {}};
  request.targets = {target};
  EXPECT_EQ(Measure(mesh, request, false).layers, layers);
}

}  // namespace
}  // namespace voxelpipe
