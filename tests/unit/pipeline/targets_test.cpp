// Values, not only occupancy: every blend against a slow reference that shades and blends fragment by fragment.
#include <bit>
#include <cmath>
#include <map>

#include "grid/grid_spec.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using namespace testing;

// Each voxel's triangles by ascending id, from runs of one triangle at a time.
std::vector<std::vector<uint32_t>> FragmentLists(const TriangleMesh& mesh, const VoxelizeRequest& request,
                                                 uint64_t voxels) {
  std::vector<std::vector<uint32_t>> lists(voxels);
  for (uint32_t t = 0; t < mesh.triangles.size(); ++t) {
    const auto& v = mesh.triangles[t];
    VoxelizeRequest single = request;
    single.targets = {TargetSpec{}};
    const VoxelizeResult r =
        RunPipeline(MakeMesh({mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]]}, {{0, 1, 2}}), single);
    for (uint64_t n = 0; n < voxels; ++n) {
      if (BitAt(r.targets[0], n)) lists[n].push_back(t);
    }
  }
  return lists;
}

// Normal of a triangle in long double, 0 for slivers that the definition calls degenerate (index space is world space).
Vec3<long double> ReferenceNormal(const TriangleMesh& mesh, uint32_t t) {
  Vec3<long double> p[3];
  for (int i = 0; i < 3; ++i) {
    const Vec3d& v = mesh.positions[mesh.triangles[t][i]];
    p[i] = {v.x, v.y, v.z};
  }
  const auto e1 = p[1] - p[0], e2 = p[2] - p[0], e3 = p[2] - p[1];
  const auto n = Cross(e1, e2);
  const long double longest = std::max({Dot(e1, e1), Dot(e2, e2), Dot(e3, e3)});
  if (std::max({std::fabs(n.x), std::fabs(n.y), std::fabs(n.z)}) <= 1e-10L * longest) return {};
  return n * (1 / std::sqrt(Dot(n, n)));
}

class BlendTest : public ::testing::TestWithParam<Coverage> {};

TEST_P(BlendTest, EveryBlendAgainstFragmentLists) {
  const TriangleMesh mesh = Soup(120, 14, 31);
  VoxelizeRequest request;
  request.coverage = GetParam();
  request.grid = UnitGrid(34, 13, 11);
  const uint64_t voxels = 34 * 13 * 11;
  const auto lists = FragmentLists(mesh, request, voxels);
  request.targets = {TargetSpec{},
                     FloatTarget(1, Blend::kReplace, {"triangle_id", {}}),
                     FloatTarget(1, Blend::kMin, {"triangle_id", {}}),
                     FloatTarget(1, Blend::kMax, {"triangle_id", {}}),
                     FloatTarget(1, Blend::kAdd, {"triangle_id", {}}),
                     FloatTarget(3, Blend::kMax, {"geometric_normal", {}}),
                     FloatTarget(3, Blend::kAdd, {"geometric_normal", {}}),
                     FloatTarget(1, Blend::kAdd, {"occupancy", {}})};
  const VoxelizeResult result = RunPipeline(mesh, request);
  uint64_t fragments = 0;
  for (uint64_t n = 0; n < voxels; ++n) {
    const auto& list = lists[n];
    fragments += list.size();
    ASSERT_EQ(BitAt(result.targets[0], n), !list.empty());
    const auto value = [&](size_t target, int c = 0) {
      return FloatAt(result.targets[target], n * uint64_t(request.targets[target].components) + uint64_t(c));
    };
    if (list.empty()) {
      for (size_t t = 1; t < 8; ++t) ASSERT_EQ(value(t), 0);
      continue;
    }
    double sum = 0;
    for (const uint32_t id : list) sum += id;
    ASSERT_EQ(value(1), float(list.back()));
    ASSERT_EQ(value(2), float(list.front()));
    ASSERT_EQ(value(3), float(list.back()));
    ASSERT_EQ(value(4), float(sum));
    ASSERT_EQ(value(7), float(list.size()));
    for (int c = 0; c < 3; ++c) {
      long double largest = -2, total = 0;
      for (const uint32_t id : list) {
        const long double component = ReferenceNormal(mesh, id)[c];
        largest = std::max(largest, component);
        total += component;
      }
      ASSERT_NEAR(value(5, c), double(largest), 1e-6);
      ASSERT_NEAR(value(6, c), double(total), 1e-6 * double(list.size()));
    }
  }
  EXPECT_EQ(result.stats.fragments, fragments);
  EXPECT_GT(fragments, 500u);
}

INSTANTIATE_TEST_SUITE_P(Coverages, BlendTest,
                         ::testing::Values(Coverage::kConservative, Coverage::kThin, Coverage::kCenter),
                         [](const auto& test) { return std::string(Name(test.param)); });

TEST(TargetsTest, FloatAddIsInQuanta) {
  VoxelizeRequest request;
  request.grid = UnitGrid(2, 2, 1);
  TargetSpec target = FloatTarget(2, Blend::kAdd, {"constant", {{"value", {0.3, 1e30}}}});
  target.quantum = 0.25;
  request.targets = {target};
  const Vec3d a{0.2, 0.2, 0.5}, b{0.8, 0.2, 0.5}, c{0.2, 0.8, 0.5};
  const VoxelizeResult r = RunPipeline(MakeMesh({a, b, c}, {{0, 1, 2}, {0, 1, 2}, {0, 1, 2}}), request);
  EXPECT_EQ(FloatAt(r.targets[0], 0), 0.75f);                     // 3 x round(0.3 / 0.25) quanta
  EXPECT_EQ(FloatAt(r.targets[0], 1), float(3 * 0x1p40 * 0.25));  // clamped to 2^40 quanta each
}

TEST(TargetsTest, BitReplaceTakesTheLargestTriangleId) {
  VoxelizeRequest request;
  request.grid = UnitGrid(1, 1, 1);
  request.targets = {TargetSpec{.blend = Blend::kReplace, .shader = {"triangle_id", {}}},
                     TargetSpec{.blend = Blend::kOr, .shader = {"triangle_id", {}}}};
  const Vec3d a{0.2, 0.2, 0.5}, b{0.8, 0.2, 0.5}, c{0.2, 0.8, 0.5};
  const VoxelizeResult one = RunPipeline(MakeMesh({a, b, c}, {{0, 1, 2}}), request);
  EXPECT_FALSE(BitAt(one.targets[0], 0));  // triangle 0: the value is 0, though the voxel is touched
  EXPECT_EQ(one.stats.occupied, 1u);
  const VoxelizeResult two = RunPipeline(MakeMesh({a, b, c}, {{0, 1, 2}, {0, 1, 2}}), request);
  EXPECT_TRUE(BitAt(two.targets[0], 0));
  EXPECT_TRUE(BitAt(two.targets[1], 0));
}

TEST(TargetsTest, ClearFillAndBlendMeetInTheRightVoxels) {
  for (const Layout layout : {Layout::kInterleaved, Layout::kPlanar}) {
    VoxelizeRequest request;
    request.grid = UnitGrid(7, 7, 7);
    request.fill = Fill::kParity;
    request.layout = layout;
    TargetSpec value = FloatTarget(2, Blend::kMax, {"constant", {{"value", {-3, -4}}}});
    value.clear = 9;  // never takes part in blending
    value.fill_values = {5};
    TargetSpec bit;
    bit.clear = 1;
    bit.fill_values = {0};
    bit.shader = {"constant", {{"value", {0}}}};
    request.targets = {value, bit, TargetSpec{}};
    TriangleMesh cube = Cube(4);
    for (Vec3d& p : cube.positions) p = p + Vec3d{1.25, 1.25, 1.25};  // surface voxels 1 and 5, inside 2 to 4
    const VoxelizeResult r = RunPipeline(cube, request);
    EXPECT_EQ(r.stats.occupied, 125u);
    for (int64_t z = 0, n = 0; z < 7; ++z) {
      for (int64_t y = 0; y < 7; ++y) {
        for (int64_t x = 0; x < 7; ++x, ++n) {
          const auto in = [&](int64_t lo, int64_t hi) {
            return std::min({x, y, z}) >= lo && std::max({x, y, z}) <= hi;
          };
          const bool surface = in(1, 5) && !in(2, 4), inside = in(2, 4);
          const uint64_t at0 = layout == Layout::kPlanar ? uint64_t(n) : uint64_t(2 * n);
          const uint64_t at1 = layout == Layout::kPlanar ? uint64_t(n + 343) : uint64_t(2 * n + 1);
          ASSERT_EQ(FloatAt(r.targets[0], at0), surface ? -3.0f : inside ? 5.0f : 9.0f) << x << y << z;
          ASSERT_EQ(FloatAt(r.targets[0], at1), surface ? -4.0f : inside ? 5.0f : 9.0f);
          ASSERT_EQ(BitAt(r.targets[1], uint64_t(n)), !surface && !inside);
          ASSERT_EQ(BitAt(r.targets[2], uint64_t(n)), surface || inside);
        }
      }
    }
  }
}

TEST(TargetsTest, BarycentricsInterpolateToTheVoxelsCentre) {
  VoxelizeRequest request;
  request.grid = UnitGrid(16, 16, 1);
  request.targets = {FloatTarget(3, Blend::kReplace, {"barycentric", {}}), TargetSpec{}};
  const VoxelizeResult r = RunPipeline(MakeMesh({{0, 0, 0.5}, {16, 0, 0.5}, {0, 16, 0.5}}, {{0, 1, 2}}), request);
  for (int y = 0, n = 0; y < 16; ++y) {
    for (int x = 0; x < 16; ++x, ++n) {
      if (!BitAt(r.targets[1], uint64_t(n)) || x + y + 1 > 16) continue;
      EXPECT_NEAR(FloatAt(r.targets[0], uint64_t(3 * n + 1)), (x + 0.5) / 16, 1e-6);
      EXPECT_NEAR(FloatAt(r.targets[0], uint64_t(3 * n + 2)), (y + 0.5) / 16, 1e-6);
    }
  }
}

TEST(TargetsTest, NormalsAreInterpolatedAndFallBackToTheGeometric) {
  TriangleMesh mesh = MakeMesh({{0, 0, 0.5}, {4, 0, 0.5}, {0, 4, 0.5}}, {{0, 1, 2}});
  VoxelizeRequest request;
  request.grid = UnitGrid(4, 4, 1);
  request.targets = {FloatTarget(3, Blend::kReplace, {"normal", {}}),
                     FloatTarget(1, Blend::kReplace, {"packed_normal", {}})};
  const VoxelizeResult flat = RunPipeline(mesh, request);
  EXPECT_EQ(FloatAt(flat.targets[0], 2), 1.0f);
  EXPECT_EQ(FloatAt(flat.targets[1], 0), float((128 << 8) | 128));
  mesh.normals = {{1, 0, 0}, {0, 1, 0}, {0, 1, 0}};
  mesh.parts[0].has_normals = true;
  const VoxelizeResult smooth = RunPipeline(mesh, request);
  const double b = 0.25, n = std::hypot(1 - b, b);  // centre (0.5, 0.5): weights 3/4, 1/8, 1/8
  EXPECT_NEAR(FloatAt(smooth.targets[0], 0), (1 - b) / n, 1e-6);
  EXPECT_NEAR(FloatAt(smooth.targets[0], 1), b / n, 1e-6);
}

TEST(TargetsTest, BaseColorIsFactorTimesTextureTimesVertexColour) {
  TriangleMesh mesh = MakeMesh({{0, 0, 0.5}, {8, 0, 0.5}, {0, 8, 0.5}}, {{0, 1, 2}});
  Material material;
  material.base_color_factor = {0.5f, 1, 1, 1};
  material.base_color.texture = 0;
  mesh.materials = {material};
  Texture texture;
  texture.image = 0;
  mesh.textures = {texture};
  auto image = std::make_shared<Image>();
  image->width = image->height = 1;
  image->rgba = {255, 188, 0, 255};
  mesh.images = {image};
  mesh.uv[0] = {{0, 0}, {1, 0}, {0, 1}};
  mesh.colors = {{1, 1, 1, 0.5f}, {1, 1, 1, 0.5f}, {1, 1, 1, 0.5f}};
  mesh.parts[0].material = 0;
  mesh.parts[0].has_uv[0] = mesh.parts[0].has_colors = true;
  VoxelizeRequest request;
  request.grid = UnitGrid(8, 8, 1);
  request.targets = {FloatTarget(4, Blend::kReplace, {"base_color", {}})};
  const VoxelizeResult r = RunPipeline(mesh, request);
  EXPECT_FLOAT_EQ(FloatAt(r.targets[0], 0), 0.5f);
  EXPECT_NEAR(FloatAt(r.targets[0], 1), 0.5028865, 1e-6);  // sRGB 188
  EXPECT_EQ(FloatAt(r.targets[0], 2), 0.0f);
  EXPECT_FLOAT_EQ(FloatAt(r.targets[0], 3), 0.5f);

  // Alpha MASK: the fragments do not happen, for this target only.
  mesh.materials[0].alpha_mode = AlphaMode::kMask;
  mesh.materials[0].alpha_cutoff = 0.6f;
  EXPECT_EQ(RunPipeline(mesh, request).stats.occupied, 0u);
  request.targets.push_back(TargetSpec{});
  const VoxelizeResult both = RunPipeline(mesh, request);
  EXPECT_GT(both.stats.occupied, 0u);
  EXPECT_EQ(FloatAt(both.targets[0], 0), 0.0f);
  EXPECT_TRUE(BitAt(both.targets[1], 0));
}

TEST(TargetsTest, TransformMovesTheMeshBeforeTheGridIsFitted) {
  VoxelizeRequest request;
  request.grid.resolution = 4;
  request.vertex_shader = {"transform", {{"matrix", {2, 0, 0, 10, 0, 2, 0, 20, 0, 0, 2, 30, 0, 0, 0, 1}}}};
  const VoxelizeResult r = RunPipeline(Cube(1), request);
  EXPECT_EQ(r.grid.origin, (Vec3d{10, 20, 30}));
  EXPECT_EQ(r.grid.voxel_size, (Vec3d{0.5, 0.5, 0.5}));
  request.vertex_shader = {"identity", {}};
  EXPECT_EQ(Bytes(r.targets[0]), Bytes(RunPipeline(Cube(1), request).targets[0]));
}

}  // namespace
}  // namespace voxelpipe
