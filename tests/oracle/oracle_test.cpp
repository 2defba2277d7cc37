// The pipeline against the brute-force reference: every voxel that the reference must have is there, and nothing that
// it may not have.
#include "support/meshes/meshes.h"
#include "support/reference/reference.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

constexpr double kTolerance = 1e-3;  // voxels: what lies nearer to a border may go either way

void ExpectBracketed(const TriangleMesh& mesh, const VoxelizeRequest& request, const char* what) {
  const VoxelizeResult result = RunPipeline(mesh, request);
  const GridSpec& grid = result.grid;
  std::vector<Vec3d> p;
  for (const Vec3d& v : mesh.positions) p.push_back(WorldToIndex(grid.index_space(), v));
  uint64_t wrong = 0, set = 0, n = 0;
  for (int64_t z = 0; z < grid.dims[2]; ++z) {
    for (int64_t y = 0; y < grid.dims[1]; ++y) {
      for (int64_t x = 0; x < grid.dims[0]; ++x, ++n) {
        const bool got = BitAt(result.targets[0], n);
        set += got;
        bool must = false, may = false;
        for (const auto& t : mesh.triangles) {
          const Vec3d &a = p[t[0]], &b = p[t[1]], &c = p[t[2]];
          // Conservative and thin miss nothing of their exact test; center may differ within the tolerance.
          const double shrink = request.coverage == Coverage::kCenter ? -kTolerance : -1e-12;
          if (!got && Touches(a, b, c, x, y, z, request.coverage, shrink)) must = true;
          if (got && Touches(a, b, c, x, y, z, request.coverage, kTolerance)) may = true;
          if (must || may) break;
        }
        if (got ? !may : must) {
          if (++wrong <= 3) {
            ADD_FAILURE() << what << ": voxel (" << x << "," << y << "," << z << ") is " << got << ", reference says "
                          << (got ? "may not" : "must");
          }
        }
      }
    }
  }
  EXPECT_EQ(wrong, 0u) << what;
  EXPECT_EQ(set, result.stats.occupied);
}

class OracleTest : public ::testing::TestWithParam<Coverage> {};

TEST_P(OracleTest, RandomSoups) {
  for (const uint32_t seed : {1u, 2u, 3u}) {
    VoxelizeRequest request;
    request.coverage = GetParam();
    request.grid = UnitGrid(35, 19, 11);  // over tile borders, no multiple of anything
    ExpectBracketed(Soup(48, 18, seed), request, "soup");
  }
}

// One triangle a time, so that no neighbour hides a hole.
TEST_P(OracleTest, SingleTriangles) {
  const TriangleMesh soup = Soup(64, 9, 77);
  for (const auto& t : soup.triangles) {
    const TriangleMesh one = MakeMesh({soup.positions[t[0]], soup.positions[t[1]], soup.positions[t[2]]}, {{0, 1, 2}});
    VoxelizeRequest request;
    request.coverage = GetParam();
    request.grid = UnitGrid(10, 9, 9);
    ExpectBracketed(one, request, "single");
  }
}

TEST_P(OracleTest, ClosedMeshesOnFittedGrids) {
  for (const GridFit fit : {GridFit::kTight, GridFit::kCube}) {
    VoxelizeRequest request;
    request.coverage = GetParam();
    request.grid.resolution = 21;
    request.grid.fit = fit;
    request.grid.padding = fit == GridFit::kTight ? 1 : 0;
    ExpectBracketed(BumpySphere(6, 5), request, "sphere");
    ExpectBracketed(Cube(1), request, "cube");
  }
}

INSTANTIATE_TEST_SUITE_P(Coverages, OracleTest,
                         ::testing::Values(Coverage::kConservative, Coverage::kThin, Coverage::kCenter),
                         [](const auto& test) { return std::string(Name(test.param)); });

TEST(ParityOracleTest, AgreesWithTheWindingNumberAwayFromTheSurface) {
  const TriangleMesh meshes[] = {BumpySphere(8, 3), Torus(16), Cube(1),
                                 Octahedron(1, Rotation({0, 0, 1}, 0.3), {0.1, 0.2, 0.3})};
  for (const TriangleMesh& mesh : meshes) {
    VoxelizeRequest request;
    request.coverage = Coverage::kCenter;  // the least surface, so that the fill itself is seen
    request.fill = Fill::kParity;
    request.grid.resolution = 24;
    request.grid.padding = 1;
    const VoxelizeResult result = RunPipeline(mesh, request);
    EXPECT_EQ(result.stats.odd_columns, 0u);
    const GridSpec& grid = result.grid;
    const Mat4d to_world = grid.index_to_world();
    uint64_t n = 0, decided = 0;
    for (int64_t z = 0; z < grid.dims[2]; ++z) {
      for (int64_t y = 0; y < grid.dims[1]; ++y) {
        for (int64_t x = 0; x < grid.dims[0]; ++x, ++n) {
          const Vec3d centre = TransformPoint(to_world, {double(x), double(y), double(z)});
          double distance = 1e9;
          for (const auto& t : mesh.triangles) {
            distance =
                std::min(distance, Distance(centre, mesh.positions[t[0]], mesh.positions[t[1]], mesh.positions[t[2]]));
          }
          if (distance < 0.9 * grid.voxel_size.x) continue;
          ++decided;
          ASSERT_EQ(BitAt(result.targets[0], n), WindingNumber(mesh.positions, mesh.triangles, centre) != 0)
              << x << "," << y << "," << z;
        }
      }
    }
    EXPECT_GT(decided, grid.voxels() / 4);
  }
}

}  // namespace
}  // namespace voxelpipe
