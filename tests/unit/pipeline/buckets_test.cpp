// The A-buffer against a list made triangle by triangle.
#include <cstring>
#include <map>

#include "gtest/gtest.h"
#include "raster/spans.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

// Voxel -> ids of the triangles that touch it, ascending.
std::map<uint64_t, std::vector<uint32_t>> Lists(const TriangleMesh& mesh, const std::array<int64_t, 3>& dims,
                                                Coverage coverage) {
  std::map<uint64_t, std::vector<uint32_t>> lists;
  const VoxelRange all{{0, 0, 0}, {dims[0], dims[1], dims[2]}};
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& v = mesh.triangles[t];
    ForEachRowSpan(SetUpTriangle(mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]], coverage), all,
                   [&](int64_t y, int64_t z, int64_t x0, int64_t x1) {
                     for (int64_t x = x0; x < x1; ++x) lists[uint64_t(x + dims[0] * (y + dims[1] * z))].push_back(t);
                   });
  }
  return lists;
}

VoxelizeRequest Buckets(const std::array<int64_t, 3>& dims, Coverage coverage) {
  VoxelizeRequest request;
  request.grid = UnitGrid(dims[0], dims[1], dims[2]);
  request.coverage = coverage;
  request.result = ResultKind::kBuckets;
  return request;
}

VoxelizeResult RunSlabs(const TriangleMesh& mesh, const VoxelizeRequest& request, int64_t slab_depth) {
  PlanLimits limits;
  limits.slab_depth = slab_depth;
  const JobContext job;
  auto result = Voxelize(mesh, request, {job, limits});
  EXPECT_TRUE(result.ok()) << result.status();
  return result.ok() ? *std::move(result) : VoxelizeResult{};
}

TEST(Buckets, ListEveryFragmentByTriangleId) {
  const TriangleMesh soup = Soup(400, 45, 31);
  for (const std::array<int64_t, 3>& dims : {std::array<int64_t, 3>{40, 37, 33}, {70, 9, 8}, {3, 3, 20}, {1, 1, 1}}) {
    for (const Coverage coverage : {Coverage::kConservative, Coverage::kThin}) {
      const auto lists = Lists(soup, dims, coverage);
      VoxelizeRequest request = Buckets(dims, coverage);
      request.targets = {TargetSpec{}, FloatTarget(3, Blend::kMax, {"barycentric", {}}),
                         FloatTarget(1, Blend::kMax, {"triangle_id", {}})};
      request.targets[2].format = VoxelFormat::kU32;
      for (const int64_t depth : {0, 8, 16}) {
        const VoxelizeResult result = RunSlabs(soup, request, depth);
        ASSERT_EQ(result.listed_voxels(), lists.size());
        ASSERT_EQ(result.stats.occupied, lists.size());
        ASSERT_EQ(result.stats.fragments, result.listed_fragments());
        uint64_t i = 0, at = 0;
        for (const auto& [voxel, ids] : lists) {
          ASSERT_EQ(ValueAt<uint64_t>(result.voxels, i), voxel);
          ASSERT_EQ(ValueAt<uint64_t>(result.offsets, i), at);
          for (const uint32_t id : ids) {
            ASSERT_EQ(ValueAt<uint32_t>(result.triangles, at), id);
            ASSERT_EQ(ValueAt<uint32_t>(result.targets[2], at), id);
            ASSERT_TRUE(BitAt(result.targets[0], at));
            const auto& v = soup.triangles[id];
            const Vec3f b = Barycentrics(SetUpPlane(soup.positions[v[0]], soup.positions[v[1]], soup.positions[v[2]]),
                                         int64_t(voxel) % dims[0], int64_t(voxel) / dims[0] % dims[1],
                                         int64_t(voxel) / dims[0] / dims[1]);
            ASSERT_EQ(ValueAt<float>(result.targets[1], at * 3), b.x);
            ASSERT_EQ(ValueAt<float>(result.targets[1], at * 3 + 2), b.z);
            ++at;
          }
          ++i;
        }
        ASSERT_EQ(ValueAt<uint64_t>(result.offsets, i), at);
        ASSERT_EQ(result.listed_fragments(), at);
      }
    }
  }
}

TEST(Buckets, AreAsLongAsCountSays) {
  TriangleMesh mesh = BumpySphere(30, 4);
  for (Vec3d& p : mesh.positions) p = p * 14.0 + Vec3d{16, 16, 16};
  VoxelizeRequest request = Buckets({33, 32, 31}, Coverage::kConservative);
  const VoxelizeResult buckets = RunSlabs(mesh, request, 0);
  request.result = ResultKind::kDense;
  request.targets = {FloatTarget(1, Blend::kCount, {"occupancy", {}})};
  request.targets[0].format = VoxelFormat::kU32;
  const VoxelizeResult dense = RunPipeline(mesh, request);
  uint64_t listed = 0;
  for (uint64_t i = 0; i < buckets.listed_voxels(); ++i) {
    const uint64_t length = ValueAt<uint64_t>(buckets.offsets, i + 1) - ValueAt<uint64_t>(buckets.offsets, i);
    ASSERT_EQ(length, ValueAt<uint32_t>(dense.targets[0], ValueAt<uint64_t>(buckets.voxels, i)));
    listed += length;
  }
  EXPECT_EQ(buckets.listed_voxels(), dense.stats.occupied);
  EXPECT_EQ(listed, *dense.stats.fragments);
}

TEST(Buckets, KeepPlanesApartWhateverTheSlabs) {
  const TriangleMesh soup = Soup(100, 30, 2);
  VoxelizeRequest request = Buckets({31, 30, 29}, Coverage::kThin);
  request.targets = {FloatTarget(3, Blend::kMax, {"geometric_normal", {}})};
  const VoxelizeResult interleaved = RunSlabs(soup, request, 0);
  request.layout = Layout::kPlanar;
  for (const int64_t depth : {0, 8}) {
    const VoxelizeResult planar = RunSlabs(soup, request, depth);
    const uint64_t m = planar.listed_fragments();
    ASSERT_EQ(m, interleaved.listed_fragments());
    for (uint64_t i = 0; i < m; ++i) {
      for (uint64_t c = 0; c < 3; ++c)
        ASSERT_EQ(FloatAt(planar.targets[0], c * m + i), FloatAt(interleaved.targets[0], i * 3 + c));
    }
  }
}

TEST(Buckets, RefuseAFillAndCenter) {
  VoxelizeRequest request = Buckets({8, 8, 8}, Coverage::kCenter);
  EXPECT_EQ(RunError(Cube(4), request).code(), absl::StatusCode::kInvalidArgument);
  request.coverage = Coverage::kThin;
  request.fill = Fill::kParity;
  EXPECT_EQ(RunError(Cube(4), request).code(), absl::StatusCode::kInvalidArgument);
}

TEST(Buckets, OfNothingHaveOneOffset) {
  const VoxelizeResult nothing = RunSlabs(MakeMesh({}, {}), Buckets({4, 4, 4}, Coverage::kThin), 0);
  EXPECT_EQ(nothing.listed_voxels(), 0u);
  ASSERT_EQ(nothing.offsets.size(), 8u);
  EXPECT_EQ(ValueAt<uint64_t>(nothing.offsets, 0), 0u);
}

// Beyond 2^32 voxels, and every triangle in one voxel.
TEST(Buckets, NumberVoxelsBeyond32BitsAndHoldDeepOnes) {
  TriangleMesh mesh = MakeMesh({{4090.5, 4090.5, 4090.5}, {4090.6, 4090.5, 4090.5}, {4090.5, 4090.6, 4090.5}}, {});
  mesh.triangles.assign(5000, {0, 1, 2});
  const VoxelizeResult deep = RunSlabs(mesh, Buckets({4096, 4096, 4096}, Coverage::kThin), 64);
  ASSERT_EQ(deep.listed_voxels(), 1u);
  EXPECT_EQ(ValueAt<uint64_t>(deep.voxels, 0), 4090ull + 4096ull * (4090ull + 4096ull * 4090ull));
  EXPECT_EQ(deep.listed_fragments(), 5000u);
  EXPECT_EQ(ValueAt<uint64_t>(deep.offsets, 1), 5000u);
  EXPECT_EQ(ValueAt<uint32_t>(deep.triangles, 4999), 4999u);
}

// Predicted were the voxels of the whole triangles, so that small grids were refused for lack of memory.
TEST(Buckets, OfHugeTrianglesInASmallGridAreNotRefused) {
  const TriangleMesh mesh = MakeMesh({{-4e9, -3e9, 2}, {4e9, -3e9, 3}, {1, 5e9, 2}}, {{0, 1, 2}});
  const VoxelizeResult result = RunPipeline(mesh, Buckets({7, 6, 5}, Coverage::kThin));
  EXPECT_GE(result.listed_fragments(), 42u);
}

}  // namespace
}  // namespace voxelpipe
