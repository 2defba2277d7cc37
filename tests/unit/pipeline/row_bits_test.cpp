// The row-span rasterizer of plain bits against the tile pipeline, on every instruction set that this machine has.
#include "cpu/rows/row_kernels.h"
#include "gtest/gtest.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

std::vector<SimdChoice> Available() {
  std::vector<SimdChoice> choices;
  for (const SimdChoice choice : {SimdChoice::kScalar, SimdChoice::kAvx2, SimdChoice::kAvx512}) {
    if (cpu::SelectRowKernels(choice).ok()) choices.push_back(choice);
  }
  return choices;
}

// The coverage by tiles: an f32 target makes the run take them.
std::vector<uint8_t> ByTiles(const TriangleMesh& mesh, VoxelizeRequest request) {
  request.targets.push_back(FloatTarget(1, Blend::kMax, {"occupancy", {}}));
  const VoxelizeResult result = RunPipeline(mesh, request);
  EXPECT_TRUE(result.stats.fragments.has_value());
  return Bytes(result.targets.at(0));
}

void ExpectTheTilesBytes(const TriangleMesh& mesh, VoxelizeRequest request) {
  const std::vector<uint8_t> expected = ByTiles(mesh, request);
  for (const SimdChoice simd : Available()) {
    for (const int threads : {1, 2}) {
      request.simd = simd;
      request.threads = threads;
      const VoxelizeResult result = RunPipeline(mesh, request);
      EXPECT_EQ(result.stats.simd, Name(simd));
      EXPECT_FALSE(result.stats.fragments.has_value()) << "the tiles ran";
      ASSERT_EQ(Bytes(result.targets.at(0)), expected)
          << Name(simd) << ", " << threads << " threads, " << Name(request.coverage);
    }
  }
}

TEST(RowBits, AreTheTilesBitsOnEveryInstructionSet) {
  for (const std::array<int64_t, 3>& dims :
       {std::array<int64_t, 3>{64, 50, 47}, {33, 61, 9}, {1, 40, 40}, {70, 1, 3}}) {
    for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter}) {
      for (const Fill fill : {Fill::kNone, Fill::kParity, Fill::kFlood}) {
        VoxelizeRequest request;
        request.grid = UnitGrid(dims[0], dims[1], dims[2]);
        request.coverage = coverage;
        request.fill = fill;
        ExpectTheTilesBytes(Soup(3000, 60, uint32_t(dims[0])), request);
      }
    }
  }
}

// From far below a voxel to far above the narrow class, so that every class and kernel has its share.
TEST(RowBits, AgreeAtEverySizeOfTriangle) {
  for (const double scale : {0.02, 0.3, 1.0, 4.0, 17.0, 90.0}) {
    TriangleMesh mesh = Soup(1500, 40, 99);
    for (const auto& t : mesh.triangles) {  // about its first vertex
      const Vec3d a = mesh.positions[t[0]];
      for (int i = 1; i < 3; ++i) mesh.positions[t[i]] = a + (mesh.positions[t[i]] - a) * (scale / 8);
    }
    for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin, Coverage::kCenter}) {
      VoxelizeRequest request;
      request.grid = UnitGrid(48, 48, 48);
      request.coverage = coverage;
      ExpectTheTilesBytes(mesh, request);
    }
  }
}

// Few triangles in a large grid go to slabs of layers first, others are set in place.
TEST(RowBits, AgreeWhereTrianglesAreFewForTheGrid) {
  TriangleMesh mesh = Soup(2500, 200, 12);
  for (size_t i = 0; i < mesh.triangles.size(); i += 2) {  // runs too
    const auto& t = mesh.triangles[i];
    for (int k = 1; k < 3; ++k)
      mesh.positions[t[k]] = mesh.positions[t[0]] + (mesh.positions[t[k]] - mesh.positions[t[0]]) * 0.05;
  }
  for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin}) {
    VoxelizeRequest request;
    request.grid = UnitGrid(310, 250, 140);
    request.coverage = coverage;
    ExpectTheTilesBytes(mesh, request);
  }
}

// Coordinates so near the origin that a quotient's remainder would underflow.
TEST(RowBits, AgreeOnCoordinatesNearZero) {
  TriangleMesh mesh = Soup(400, 20, 8);
  for (size_t i = 0; i < mesh.positions.size(); i += 5) mesh.positions[i].y = i % 2 == 0 ? 0x1p-1060 : -0.0;
  VoxelizeRequest request;
  request.grid = UnitGrid(24, 24, 24);
  ExpectTheTilesBytes(mesh, request);
}

TEST(RowBits, WorkInSlabsAndFarFromTheOrigin) {
  TriangleMesh mesh = BumpySphere(40, 5);
  for (Vec3d& p : mesh.positions) p = p + Vec3d{1e6, -1e6, 3e5};
  VoxelizeRequest request;
  request.grid.resolution = 97;
  ExpectTheTilesBytes(mesh, request);
  request.threads = 2;
  const VoxelizeResult whole = RunPipeline(mesh, request);
  PlanLimits limits;
  limits.slab_depth = 24;
  const JobContext job;
  const auto slabs = Voxelize(mesh, request, {job, limits});
  ASSERT_TRUE(slabs.ok());
  EXPECT_EQ(Bytes(slabs->targets[0]), Bytes(whole.targets[0]));
}

TEST(RowBits, SelectSaysWhatIsMissing) {
  ASSERT_TRUE(cpu::SelectRowKernels(SimdChoice::kScalar).ok());
  EXPECT_EQ((*cpu::SelectRowKernels(SimdChoice::kScalar))->name, "scalar");
  ASSERT_TRUE(cpu::SelectRowKernels(SimdChoice::kAuto).ok());
  for (const SimdChoice choice : {SimdChoice::kAvx2, SimdChoice::kAvx512}) {
    const auto kernels = cpu::SelectRowKernels(choice);
    if (kernels.ok()) {
      EXPECT_EQ((*kernels)->name, Name(choice));
    } else {
      EXPECT_EQ(kernels.status().code(), absl::StatusCode::kFailedPrecondition);
    }
  }
}

}  // namespace
}  // namespace voxelpipe
