#include "mesh/health/health.h"

#include <gtest/gtest.h>

#include <chrono>
#include <limits>
#include <utility>

#include "mesh/health/fill_advice.h"
#include "mesh/health/shells.h"
#include "mesh/weld.h"
#include "support/meshes/meshes.h"

namespace voxelpipe {
namespace {

using namespace testing;

MeshHealth HealthOf(const TriangleMesh& mesh) {
  const JobContext job;
  const absl::StatusOr<MeshHealth> health = CheckHealth(job, mesh);
  EXPECT_TRUE(health.ok()) << health.status();
  return health.value_or(MeshHealth{});
}

void Append(TriangleMesh& mesh, const TriangleMesh& more, const Vec3d& offset) {
  const auto first = uint32_t(mesh.positions.size());
  for (const Vec3d& p : more.positions) mesh.positions.push_back(p + offset);
  for (const auto& t : more.triangles) mesh.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
}

TriangleMesh Flipped(TriangleMesh mesh) {
  for (auto& t : mesh.triangles) std::swap(t[1], t[2]);
  return mesh;
}

// A box [0, x] x [0, y] x [0, z] that faces outward.
TriangleMesh Box(double x, double y, double z) {
  TriangleMesh mesh = Cube(1);
  for (Vec3d& p : mesh.positions) p = {p.x * x, p.y * y, p.z * z};
  return mesh;
}

TEST(HealthTest, AClosedShellIsWatertightAndSuitsParity) {
  const MeshHealth health = HealthOf(Cube(2));
  EXPECT_TRUE(health.watertight);
  EXPECT_EQ(health.edges.edges, 18u);
  EXPECT_EQ(health.edges.open + health.edges.non_manifold + health.edges.inconsistent, 0u);
  EXPECT_EQ(health.shells, 1u);
  EXPECT_EQ(health.closed_shells, 1u);
  EXPECT_EQ(health.flipped_shells, 0u);
  EXPECT_DOUBLE_EQ(health.volume, 8);
  EXPECT_EQ(AdviseFill(health).fill, Fill::kParity);
}

TEST(HealthTest, AHoleOpensEdgesAndSuitsFlood) {
  TriangleMesh mesh = Cube(1);
  mesh.triangles.pop_back();
  const MeshHealth health = HealthOf(mesh);
  EXPECT_FALSE(health.watertight);
  EXPECT_EQ(health.edges.open, 3u);
  EXPECT_EQ(health.closed_shells, 0u);
  EXPECT_EQ(AdviseFill(health).fill, Fill::kFlood);
}

TEST(HealthTest, NothingSuitsAMeshWithoutTriangles) {
  const MeshHealth health = HealthOf(MakeMesh({}, {}));
  EXPECT_FALSE(health.watertight);
  EXPECT_EQ(AdviseFill(health).fill, Fill::kNone);
  EXPECT_EQ(AdviseFill(HealthOf(MakeMesh({{0, 0, 0}}, {{0, 0, 0}}))).fill, Fill::kNone);
}

TEST(HealthTest, AFlippedShellHasNegativeVolume) {
  const MeshHealth health = HealthOf(Flipped(Cube(1)));
  EXPECT_EQ(health.flipped_shells, 1u);
  EXPECT_DOUBLE_EQ(health.volume, -1);
  EXPECT_EQ(health.edges.inconsistent, 0u);
}

TEST(HealthTest, AFlippedTriangleMakesItsEdgesInconsistent) {
  TriangleMesh mesh = Cube(1);
  std::swap(mesh.triangles[0][1], mesh.triangles[0][2]);
  const MeshHealth health = HealthOf(mesh);
  EXPECT_TRUE(health.watertight);
  EXPECT_EQ(health.edges.inconsistent, 3u);
  EXPECT_EQ(health.flipped_shells, 0u);
  EXPECT_EQ(AdviseFill(health).fill, Fill::kParity);
}

TEST(HealthTest, DuplicatesCountByPosition) {
  TriangleMesh mesh = Cube(1);
  Append(mesh, Flipped(Cube(1)), {0, 0, 0});
  mesh.positions.push_back({-0.0, 0, 0});
  const MeshHealth health = HealthOf(mesh);
  EXPECT_EQ(health.duplicate_triangles, 12u);
  EXPECT_EQ(health.duplicate_vertices, 9u);
  EXPECT_EQ(health.edges.non_manifold, 18u);
  EXPECT_EQ(health.shells, 1u) << "connected through the edges that both use";
}

TEST(HealthTest, ADoubledShellSuitsNonzero) {
  TriangleMesh mesh = Cube(1);
  Append(mesh, Cube(1), {0, 0, 0});
  EXPECT_EQ(AdviseFill(HealthOf(mesh)).fill, Fill::kNonzero);
}

TEST(HealthTest, ATriangleWithTwoEqualCornersLeavesTheEdgesAlone) {
  TriangleMesh mesh = Cube(1);
  mesh.triangles.push_back({0, 1, 1});
  const MeshHealth health = HealthOf(mesh);
  EXPECT_EQ(health.degenerate_triangles, 1u);
  EXPECT_EQ(health.edges.non_manifold, 0u);
  EXPECT_TRUE(health.watertight);
}

TEST(HealthTest, PositionsThatAreNotFiniteAreCountedAndOpenTheMesh) {
  for (const double value : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    TriangleMesh mesh = Cube(1);
    mesh.positions[3].y = value;
    const MeshHealth health = HealthOf(mesh);
    EXPECT_EQ(health.not_finite_vertices, 1u);
    EXPECT_FALSE(health.watertight);
    EXPECT_EQ(AdviseFill(health).fill, Fill::kFlood);
  }
}

TEST(HealthTest, ShellsApartDoNotOverlap) {
  TriangleMesh mesh = Cube(1);
  Append(mesh, Cube(1), {3, 0, 0});
  Append(mesh, Torus(9), {0, 9, 0});
  const MeshHealth health = HealthOf(mesh);
  EXPECT_EQ(health.shells, 3u);
  EXPECT_FALSE(health.overlaps.any());
  EXPECT_EQ(AdviseFill(health).fill, Fill::kParity);
}

TEST(HealthTest, ContactIsNoOverlap) {
  for (const Vec3d& offset : {Vec3d{1, 0.25, 0.25}, Vec3d{0.25, 1, 0.25}, Vec3d{0.25, 0.25, 1}, Vec3d{-0.5, 0.25, 0.25},
                              Vec3d{0.25, -0.5, 0.25}, Vec3d{0.25, 0.25, -0.5}}) {
    TriangleMesh mesh = Cube(1);
    Append(mesh, Cube(0.5), offset);
    EXPECT_FALSE(HealthOf(mesh).overlaps.any()) << offset.x << " " << offset.y << " " << offset.z;
  }
}

TEST(HealthTest, ShellsThatIntersectSuitNonzero) {
  TriangleMesh mesh = Cube(2);
  Append(mesh, Cube(2), {1, 1, 1});
  const MeshHealth health = HealthOf(mesh);
  EXPECT_EQ(health.overlaps.overlapping, 2u);
  EXPECT_EQ(AdviseFill(health).fill, Fill::kNonzero);
}

TEST(HealthTest, CrossedBarsAreFoundByTheirBoxes) {
  TriangleMesh mesh = Box(5, 1, 1);
  Append(mesh, Box(1, 5, 1), {2, -2, 0.5});
  Append(mesh, Cube(1), {20, 20, 20});
  const MeshHealth health = HealthOf(mesh);
  EXPECT_EQ(health.overlaps.overlapping + health.overlaps.nested, 0u);
  EXPECT_EQ(health.overlaps.boxes_only, 2u);
  EXPECT_EQ(AdviseFill(health).fill, Fill::kNonzero);
}

TEST(HealthTest, AFlippedShellInsideAnotherIsACavity) {
  TriangleMesh mesh = Cube(4);
  Append(mesh, Flipped(Cube(1)), {1, 1, 1});
  const MeshHealth health = HealthOf(mesh);
  EXPECT_EQ(health.flipped_shells, 1u);
  EXPECT_EQ(health.overlaps.nested, 1u);
  EXPECT_EQ(health.overlaps.cavities, 1u);
  EXPECT_EQ(health.overlaps.boxes_only, 0u);
  EXPECT_DOUBLE_EQ(health.volume, 63);
  EXPECT_EQ(AdviseFill(health).fill, Fill::kParity);
}

TEST(HealthTest, AShellInsideAnotherThatFacesTheSameWayIsNoCavity) {
  TriangleMesh mesh = Cube(4);
  Append(mesh, Cube(1), {1, 1, 1});
  const MeshHealth health = HealthOf(mesh);
  EXPECT_EQ(health.overlaps.nested, 1u);
  EXPECT_EQ(health.overlaps.cavities, 0u);
  EXPECT_EQ(AdviseFill(health).fill, Fill::kNonzero);
  // One that faces inward would be cancelled by the other.
  TriangleMesh both = Flipped(Cube(4));
  Append(both, Cube(1), {1, 1, 1});
  EXPECT_EQ(AdviseFill(HealthOf(both)).fill, Fill::kFlood);
}

TEST(HealthTest, ManySmallShellsInALargeOneAreAllFound) {
  TriangleMesh mesh = BumpySphere(40, 3);
  for (Vec3d& p : mesh.positions) p = p * 100.0;
  for (int i = 0; i < 300; ++i) Append(mesh, Cube(0.5), {double(i % 10), double(i / 10 % 10), double(i / 100)});
  const MeshHealth health = HealthOf(mesh);
  EXPECT_EQ(health.closed_shells, 301u);
  EXPECT_EQ(health.overlaps.nested, 300u);
  EXPECT_EQ(health.overlaps.undecided, 0u);
}

// The mesh takes far longer than the job has.
TEST(HealthTest, AnExaminationEndsMidway) {
  const TriangleMesh mesh = Soup(400'000, 10, 7);
  JobContext job;
  job.set_deadline(JobContext::Clock::now() + std::chrono::milliseconds(5));
  EXPECT_EQ(CheckHealth(job, mesh).status().code(), absl::StatusCode::kDeadlineExceeded);
}

// One cell of the grid over y and z holds all triangles, so that a single line meets all of them.
TEST(HealthTest, OverlapsEndWithTheirJobWhereOneLineMeetsAllShells) {
  TriangleMesh mesh;
  for (int i = 0; i < 20'000; ++i) Append(mesh, Cube(1), {2.0 * i, 0, 0});
  JobContext job;
  const absl::StatusOr<WeldedVertices> welded = Weld(job, mesh.positions);
  ASSERT_TRUE(welded.ok());
  absl::StatusOr<ShellList> list = FindShells(job, mesh, *welded, {});
  ASSERT_TRUE(list.ok());
  ASSERT_TRUE(MeasureShells(job, mesh, *list).ok());
  job.set_deadline(JobContext::Clock::now() + std::chrono::milliseconds(20));
  EXPECT_EQ(FindOverlaps(job, mesh, *list).status().code(), absl::StatusCode::kDeadlineExceeded);
  job.Cancel();
  EXPECT_EQ(FindShells(job, mesh, *welded, {}).status().code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(MeasureShells(job, mesh, *list).code(), absl::StatusCode::kCancelled);
  EXPECT_EQ(FindOverlaps(job, mesh, *list).status().code(), absl::StatusCode::kCancelled);
}

TEST(HealthTest, AnEndedJobAndASmallBudgetAreRespected) {
  JobContext job;
  job.Cancel();
  EXPECT_EQ(CheckHealth(job, Cube(1)).status().code(), absl::StatusCode::kCancelled);
  MemoryBudget small(500);
  JobContext poor;
  poor.set_memory(&small);
  EXPECT_EQ(CheckHealth(poor, Cube(1)).status().code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(small.used_bytes(), 0u);
}

TEST(HealthTest, TwoRunsAgree) {
  const TriangleMesh soup = Soup(3000, 10, 7);
  const MeshHealth a = HealthOf(soup), b = HealthOf(soup);
  EXPECT_EQ(a.edges.open, b.edges.open);
  EXPECT_EQ(a.shells, b.shells);
  EXPECT_EQ(a.volume, b.volume);
}

}  // namespace
}  // namespace voxelpipe
