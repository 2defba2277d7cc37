// Flood fill against a plain breadth-first search, voxel by voxel.
#include <algorithm>
#include <deque>

#include "bench/meshes.h"
#include "gtest/gtest.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

struct Dims {
  int64_t nx, ny, nz;
};

VoxelizeRequest Request(const Dims& d, Coverage coverage, Fill fill) {
  VoxelizeRequest request;
  request.grid = UnitGrid(d.nx, d.ny, d.nz);
  request.coverage = coverage;
  request.fill = fill;
  return request;
}

std::vector<bool> Occupied(const TriangleMesh& mesh, const Dims& d, Coverage coverage, Fill fill) {
  const VoxelizeResult result = RunPipeline(mesh, Request(d, coverage, fill));
  std::vector<bool> bits(size_t(d.nx * d.ny * d.nz));
  for (size_t n = 0; n < bits.size(); ++n) bits[n] = BitAt(result.targets.at(0), n);
  EXPECT_EQ(result.stats.occupied, uint64_t(std::count(bits.begin(), bits.end(), true)));
  return bits;
}

// The voxels that a search from a layer around the grid reaches through voxels outside `shell`.
std::vector<bool> Reached(const std::vector<bool>& shell, const Dims& d) {
  std::vector<bool> reached(shell.size());
  std::deque<std::array<int64_t, 3>> open;
  const auto visit = [&](int64_t x, int64_t y, int64_t z) {
    if (x < 0 || y < 0 || z < 0 || x >= d.nx || y >= d.ny || z >= d.nz) return;
    const size_t n = size_t(x + d.nx * (y + d.ny * z));
    if (shell[n] || reached[n]) return;
    reached[n] = true;
    open.push_back({x, y, z});
  };
  for (int64_t z = 0; z < d.nz; ++z) {
    for (int64_t y = 0; y < d.ny; ++y) {
      for (int64_t x = 0; x < d.nx; ++x) {
        if (x == 0 || y == 0 || z == 0 || x == d.nx - 1 || y == d.ny - 1 || z == d.nz - 1) visit(x, y, z);
      }
    }
  }
  for (; !open.empty(); open.pop_front()) {
    const auto [x, y, z] = open.front();
    visit(x - 1, y, z), visit(x + 1, y, z), visit(x, y - 1, z), visit(x, y + 1, z), visit(x, y, z - 1),
        visit(x, y, z + 1);
  }
  return reached;
}

// Moves a mesh about the origin into the middle of the grid.
TriangleMesh Placed(TriangleMesh mesh, double scale, const Vec3d& centre) {
  for (Vec3d& p : mesh.positions) p = p * scale + centre;
  return mesh;
}

void ExpectFloodIsTheWalk(const TriangleMesh& mesh, const Dims& d) {
  const std::vector<bool> shell = Occupied(mesh, d, Coverage::kConservative, Fill::kNone);
  const std::vector<bool> reached = Reached(shell, d);
  for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter}) {
    const std::vector<bool> flooded = Occupied(mesh, d, coverage, Fill::kFlood);
    for (size_t n = 0; n < flooded.size(); ++n) {
      ASSERT_EQ(flooded[n], !reached[n]) << "voxel " << n << ", " << Name(coverage);
    }
  }
}

TEST(FloodFill, FillsClosedSurfacesAndKeepsHolesThatReachOut) {
  ExpectFloodIsTheWalk(Placed(Torus(24), 20, {33.3, 30.1, 31.7}), {67, 61, 63});
  ExpectFloodIsTheWalk(Placed(BumpySphere(20, 3), 25, {32, 30, 28}), {65, 60, 57});
}

TEST(FloodFill, FillsNothingBehindASurfaceThatIsOpenToTheGridsSide) {
  TriangleMesh mesh = Placed(BumpySphere(20, 3), 25, {32, 30, 28});
  mesh.triangles.resize(mesh.triangles.size() / 2);
  ExpectFloodIsTheWalk(mesh, {65, 60, 57});
  const std::vector<bool> shell = Occupied(mesh, {65, 60, 57}, Coverage::kConservative, Fill::kNone);
  EXPECT_EQ(Occupied(mesh, {65, 60, 57}, Coverage::kConservative, Fill::kFlood), shell);
}

// A grid inside the mesh sees no outside but its own border.
TEST(FloodFill, FollowsWindingWaysThroughASoup) {
  for (const Dims& d : {Dims{40, 33, 29}, Dims{1, 30, 30}, Dims{64, 1, 40}, Dims{33, 8, 8}}) {
    ExpectFloodIsTheWalk(Soup(60, 40, 7), d);
  }
}

TEST(FloodFill, GivesFilledVoxelsTheirValueAndCoveredOnesTheirs) {
  const TriangleMesh mesh = Placed(Octahedron(1, Rotation({0, 0, 1}, 0.3), {0, 0, 0}), 12, {16, 16, 16});
  VoxelizeRequest request = Request({32, 32, 32}, Coverage::kThin, Fill::kFlood);
  request.targets = {FloatTarget(1, Blend::kMax, {"constant", {{"value", {3}}}})};
  request.targets[0].clear = -1;
  request.targets[0].fill_values = {7};
  const VoxelizeResult result = RunPipeline(mesh, request);
  EXPECT_EQ(FloatAt(result.targets[0], 16 + 32 * (16 + 32 * 16)), 7);
  EXPECT_EQ(FloatAt(result.targets[0], 0), -1);
  const std::vector<bool> thin = Occupied(mesh, {32, 32, 32}, Coverage::kThin, Fill::kNone);
  for (size_t n = 0; n < thin.size(); ++n) {
    if (thin[n]) {
      ASSERT_EQ(FloatAt(result.targets[0], n), 3) << n;
    }
  }
}

void Append(TriangleMesh& mesh, const TriangleMesh& other) {
  const auto first = uint32_t(mesh.positions.size());
  std::vector<Vec3d> positions = mesh.positions;
  std::vector<std::array<uint32_t, 3>> triangles = mesh.triangles;
  positions.insert(positions.end(), other.positions.begin(), other.positions.end());
  for (const auto& t : other.triangles) triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  mesh = MakeMesh(std::move(positions), std::move(triangles));
}

// Below, at and above words of 32 and of 64 voxels.
constexpr int64_t kSizes[] = {1, 31, 32, 33, 63, 64, 65, 127, 129};

TEST(FloodFill, WalksAMazeWhateverTheSizeOfTheGrid) {
  for (const int64_t size : kSizes) {
    const TriangleMesh maze = bench::Maze(std::max(1, int(size / 8)));
    for (const Dims& d : {Dims{size, size, size}, Dims{size, 30, 21}, Dims{19, size, 30}, Dims{21, 30, size}}) {
      TriangleMesh scaled = maze;
      for (Vec3d& p : scaled.positions) p = {p.x * double(d.nx), p.y * double(d.ny), p.z * double(d.nz)};
      ExpectFloodIsTheWalk(scaled, d);
      if (HasFatalFailure()) return;
    }
  }
  // All of its rooms are open.
  TriangleMesh maze = bench::Maze(16);
  for (Vec3d& p : maze.positions) p = p * 129.0;
  const Dims d{129, 129, 129};
  EXPECT_EQ(Occupied(maze, d, Coverage::kConservative, Fill::kFlood),
            Occupied(maze, d, Coverage::kConservative, Fill::kNone));
}

TEST(FloodFill, FillsWhatTheOuterOneOfNestedShellsEncloses) {
  const Vec3d centre{33, 32, 31};
  TriangleMesh shells = Placed(BumpySphere(20, 3), 24, centre);
  Append(shells, Placed(BumpySphere(16, 4), 16, centre));
  Append(shells, Placed(Octahedron(1, Rotation({1, 2, 3}, 0.4), {0, 0, 0}), 8, centre));
  ExpectFloodIsTheWalk(shells, {66, 64, 62});
  // The outer one is open.
  TriangleMesh open = Placed(BumpySphere(20, 3), 24, centre);
  open.triangles.resize(open.triangles.size() - 300);
  open = MakeMesh(open.positions, open.triangles);
  Append(open, Placed(BumpySphere(16, 4), 16, centre));
  ExpectFloodIsTheWalk(open, {66, 64, 62});
}

TEST(FloodFill, LeavesAnOpenBoxEmptyOnEachSide) {
  for (int side = 0; side < 6; ++side) {
    TriangleMesh box = Cube(40);
    ASSERT_EQ(box.triangles.size(), 12u);
    box.triangles.erase(box.triangles.begin() + 2 * side, box.triangles.begin() + 2 * side + 2);
    box = MakeMesh(box.positions, box.triangles);
    Vec3d low = box.positions[0];
    for (const Vec3d& p : box.positions) low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
    for (Vec3d& p : box.positions) p = p - low + Vec3d{12.5, 9.5, 8.5};
    const Dims d{65, 63, 64};
    ExpectFloodIsTheWalk(box, d);
    EXPECT_EQ(Occupied(box, d, Coverage::kConservative, Fill::kFlood),
              Occupied(box, d, Coverage::kConservative, Fill::kNone));
  }
}

// Where the coverage is the shell it is not drawn again; elsewhere it is. The bytes are the same.
TEST(FloodFill, IsTheSameInSlabsByStreamAndOnEveryNumberOfThreads) {
  TriangleMesh maze = bench::Maze(9);
  for (Vec3d& p : maze.positions) p = {p.x * 65, p.y * 60, p.z * 70};
  std::vector<std::vector<TargetSpec>> lists(4);
  lists[0] = {TargetSpec{}};
  lists[1] = {FloatTarget(1, Blend::kMax, {"occupancy", {}})};
  lists[2] = {TargetSpec{}, FloatTarget(4, Blend::kReplace, {"base_color", {}})};
  lists[3] = {TargetOf(VoxelFormat::kBit, 1, Blend::kOr, {"occupancy", {}})};
  lists[3][0].clear = 1;
  lists[3][0].fill_values = {0};
  for (const std::vector<TargetSpec>& targets : lists) {
    for (const ResultKind result : {ResultKind::kDense, ResultKind::kSparse}) {
      for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin}) {
        VoxelizeRequest request = Request({65, 60, 70}, coverage, Fill::kFlood);
        request.targets = targets;
        request.result = result;
        request.threads = 1;
        const Arrays expected = CopyArrays(RunPipeline(maze, request));
        for (const int threads : {1, 2}) {
          request.threads = threads;
          for (const int64_t depth : {0, 8, 24}) {
            PlanLimits limits;
            limits.slab_depth = depth;
            const JobContext job;
            const auto whole = Voxelize(maze, request, {job, limits});
            ASSERT_TRUE(whole.ok()) << whole.status();
            EXPECT_EQ(CopyArrays(*whole), expected) << threads << " threads, slabs of " << depth;
            KeepArrays sink;
            const auto streamed = VoxelizeTo(maze, request, {job, limits}, sink);
            ASSERT_TRUE(streamed.ok()) << streamed.status();
            EXPECT_EQ(sink.arrays, expected) << threads << " threads, slabs of " << depth << ", streamed";
          }
        }
      }
    }
  }
}

// The coverage of such targets lacks voxels of the shell, so that it lets the flood through.
TEST(FloodFill, TakesTheShellOfTrianglesWhoseFragmentsAreDiscarded) {
  TriangleMesh mesh = Placed(BumpySphere(20, 3), 25, {32, 30, 28});
  Material masked;
  masked.alpha_mode = AlphaMode::kMask;
  masked.base_color_factor = {1, 1, 1, 0.2f};
  masked.alpha_cutoff = 0.5f;
  mesh.materials = {masked};
  for (MeshPart& part : mesh.parts) part.material = 0;
  const Dims d{65, 60, 57};
  const std::vector<bool> solid = Occupied(mesh, d, Coverage::kConservative, Fill::kFlood);
  VoxelizeRequest request = Request(d, Coverage::kConservative, Fill::kFlood);
  request.targets = {FloatTarget(4, Blend::kReplace, {"base_color", {}})};
  request.targets[0].fill_values = {7, 7, 7, 7};
  const VoxelizeResult result = RunPipeline(mesh, request);
  EXPECT_EQ(result.stats.occupied, uint64_t(std::count(solid.begin(), solid.end(), true)));
  for (size_t n = 0; n < solid.size(); ++n) {
    ASSERT_EQ(FloatAt(result.targets[0], 4 * n), solid[n] ? 7 : 0) << "voxel " << n;
  }
}

}  // namespace
}  // namespace voxelpipe
