// Sparse results hold exactly the occupied voxels of the dense ones, with their values.
#include <cstring>

#include "gtest/gtest.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

// Element `index` of a target's array, as the bits that are stored.
uint32_t Stored(const HostBuffer& array, VoxelFormat format, uint64_t index) {
  switch (BitsPerComponent(format)) {
    case 1: return BitAt(array, index);
    case 8: return ValueAt<uint8_t>(array, index);
    case 16: return ValueAt<uint16_t>(array, index);
    default: return ValueAt<uint32_t>(array, index);
  }
}

// Walks the bricks and holds every listed value against the dense result; the voxels not listed must not be occupied.
void ExpectDenseValues(const TriangleMesh& mesh, VoxelizeRequest request, const PlanLimits& limits = {}) {
  request.result = ResultKind::kDense;
  const VoxelizeResult dense = RunPipeline(mesh, request);
  request.result = ResultKind::kSparse;
  const JobContext job;
  const auto made = Voxelize(mesh, request, {job, limits});
  ASSERT_TRUE(made.ok()) << made.status();
  const VoxelizeResult& sparse = *made;
  ASSERT_EQ(sparse.listed_voxels(), dense.stats.occupied);
  ASSERT_EQ(sparse.stats.occupied, dense.stats.occupied);
  ASSERT_EQ(sparse.masks.size(), sparse.listed_bricks() * 64);
  const auto& dims = dense.grid.dims;
  const int64_t bx = (dims[0] + 7) / 8, by = (dims[1] + 7) / 8;
  uint64_t n = 0, last = 0;
  for (uint64_t b = 0; b < sparse.listed_bricks(); ++b) {
    const auto id = ValueAt<uint64_t>(sparse.bricks, b);
    ASSERT_TRUE(b == 0 || id > last) << "ascending";
    last = id;
    uint64_t in_brick = 0;
    for (int i = 0; i < 512; ++i) {
      if ((sparse.masks.data()[b * 64 + uint64_t(i / 8)] >> (i % 8) & 1) == 0) continue;
      ++in_brick;
      const uint64_t x = id % uint64_t(bx) * 8 + uint64_t(i % 8),
                     y = id / uint64_t(bx) % uint64_t(by) * 8 + uint64_t(i / 8 % 8);
      const uint64_t z = id / uint64_t(bx * by) * 8 + uint64_t(i / 64);
      ASSERT_LT(x, uint64_t(dims[0]));
      ASSERT_LT(y, uint64_t(dims[1]));
      ASSERT_LT(z, uint64_t(dims[2]));
      const uint64_t voxel = x + uint64_t(dims[0]) * (y + uint64_t(dims[1]) * z);
      for (size_t t = 0; t < request.targets.size(); ++t) {
        const TargetSpec& spec = request.targets[t];
        const auto components = uint64_t(spec.components);
        const bool planar = request.layout == Layout::kPlanar;
        for (uint64_t c = 0; c < components; ++c) {
          const uint64_t from = planar ? c * sparse.listed_voxels() + n : n * components + c;
          const uint64_t at = planar ? c * dense.grid.voxels() + voxel : voxel * components + c;
          ASSERT_EQ(Stored(sparse.targets[t], spec.format, from), Stored(dense.targets[t], spec.format, at))
              << "target " << t << ", voxel " << x << " " << y << " " << z;
        }
      }
      ++n;
    }
    ASSERT_GT(in_brick, 0u) << "an empty brick is listed";
  }
  EXPECT_EQ(n, dense.stats.occupied);
}

VoxelizeRequest Mixed(const std::array<int64_t, 3>& dims, Fill fill, Layout layout) {
  VoxelizeRequest request;
  request.grid = UnitGrid(dims[0], dims[1], dims[2]);
  request.fill = fill;
  request.layout = layout;
  request.targets = {TargetOf(VoxelFormat::kBit, 1, Blend::kAnd, {"checker", {}}),
                     TargetOf(VoxelFormat::kF32, 3, Blend::kMax, {"geometric_normal", {}}),
                     TargetOf(VoxelFormat::kU16, 1, Blend::kMin, {"packed_normal", {}}),
                     TargetSpec{},
                     TargetOf(VoxelFormat::kF16, 4, Blend::kAdd, {"barycentric", {}}),
                     TargetOf(VoxelFormat::kU8, 2, Blend::kCount, {"triangle_id", {}})};
  request.targets[1].clear = -3;
  request.targets[1].fill_values = {0.25};
  return request;
}

TEST(Sparse, HoldsTheDenseValuesOfTheOccupiedVoxels) {
  const TriangleMesh soup = Soup(250, 45, 17);
  for (const std::array<int64_t, 3>& dims : {std::array<int64_t, 3>{40, 37, 33}, {65, 8, 9}, {5, 3, 1}}) {
    for (const Fill fill : {Fill::kNone, Fill::kParity, Fill::kFlood, Fill::kNonzero}) {
      for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
        ExpectDenseValues(soup, Mixed(dims, fill, layout));
      }
    }
  }
}

TEST(Sparse, DoesNotDependOnTheSlabs) {
  TriangleMesh mesh = BumpySphere(24, 9);
  for (Vec3d& p : mesh.positions) p = p * 20.0 + Vec3d{24, 24, 24};
  for (const int64_t depth : {8, 16, 40}) {
    PlanLimits limits;
    limits.slab_depth = depth;
    for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
      ExpectDenseValues(mesh, Mixed({50, 47, 45}, Fill::kParity, layout), limits);
    }
  }
}

TEST(Sparse, PlainBitsGoByRows) {
  VoxelizeRequest request;
  request.grid.resolution = 70;
  ExpectDenseValues(Torus(40), request);
  request.fill = Fill::kFlood;
  ExpectDenseValues(Torus(40), request);
  request.result = ResultKind::kSparse;
  EXPECT_FALSE(RunPipeline(Torus(40), request).stats.fragments.has_value());
}

TEST(Sparse, OfNothingIsEmpty) {
  VoxelizeRequest request;
  request.result = ResultKind::kSparse;
  const VoxelizeResult nothing = RunPipeline(MakeMesh({}, {}), request);
  EXPECT_EQ(nothing.listed_bricks(), 0u);
  EXPECT_EQ(nothing.targets.at(0).size(), 0u);
}

// A grid whose dense result would not fit is no larger than its surface.
TEST(Sparse, TakesMemoryByTheSurface) {
  VoxelizeRequest request;
  request.grid.resolution = 1500;
  request.result = ResultKind::kSparse;
  request.targets = {FloatTarget(1, Blend::kMax, {"triangle_id", {}})};
  PlanLimits limits;
  limits.max_working_bytes = 2ull << 30;
  const JobContext job;
  Plan plan;
  const auto result = Voxelize(Torus(8), request, {job, limits, KeepPlan(plan)});
  ASSERT_TRUE(result.ok()) << result.status();
  const uint64_t bytes = result->bricks.size() + result->masks.size() + result->targets[0].size();
  EXPECT_LT(bytes, 200u << 20);
  EXPECT_LT(double(plan.result_bytes), 1.5 * double(bytes));
  EXPECT_GT(double(plan.result_bytes), double(bytes) / 1.5);
}

}  // namespace
}  // namespace voxelpipe
