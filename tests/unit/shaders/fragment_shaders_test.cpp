// Values of the fragment shaders that read no texture, against numbers worked out by hand.
#include <cmath>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "support/meshes/meshes.h"
#include "support/run.h"
#include "support/shading.h"

namespace voxelpipe {
namespace {

using testing::Floats;
using testing::ShadeOne;
using testing::ShadingScene;

constexpr Vec3f kQuarters{0.25f, 0.25f, 0.5f};

// Every fragment shader that does not read textures, on a part with everything or with nothing.
template <typename Check>
void ForEachShader(bool attributes, const Check& check) {
  ShadingScene scene;
  const Vec3f normals[3] = {{0, 0, 1}, {0, 1, 0}, {1, 0, 0}}, velocities[3] = {{1, 2, 3}, {0, 1, 0}, {5, 0, 0}};
  const Vec4f tangents[3] = {{1, 0, 0, 1}, {0, 1, 0, 1}, {0, 0, 1, 1}}, colors[3] = {{1, 0, 0, 1}, {}, {0, 1, 1, 1}};
  const Vec2f uv[3] = {{0, 0}, {1, 0}, {0, 8}};
  MeshView view = scene.View();
  if (attributes) {
    view.normals = normals;
    view.velocities = velocities;
    view.tangents = tangents;
    view.colors = colors;
    view.uv[0] = uv;
    scene.part.has_normals = scene.part.has_tangents = scene.part.has_colors = scene.part.has_uv[0] = true;
  }
  for (const ShaderInfo& info : ListShaders()) {
    if (info.stage != ShaderStage::kFragment || info.reads_textures || info.name == "attribute") continue;
    const auto bound = BindShader(ShaderStage::kFragment, {info.name, {}});
    ASSERT_TRUE(bound.ok()) << bound.status();
    check(view, info.name, FragmentShaderId(bound->id), bound->params);
  }
}

std::vector<float> Shaded(FragmentShaderId id, FragmentInput in, const ShaderParams& params, const Vec3f& barycentric,
                          int64_t x) {
  in.barycentric = barycentric;
  in.voxel[0] = x;
  FragmentOutput out;
  ShadeFragment(id, in, params, out);
  std::vector<float> all(out.f, out.f + 4);
  for (const uint32_t u : out.u) all.push_back(float(u));
  return all;
}

TEST(SameForTriangleTest, IsSaidOfShadersWhoseOutputDoesNotVary) {
  for (const bool attributes : {false, true}) {
    int same = 0, varying = 0;
    ForEachShader(attributes,
                  [&](const MeshView& view, const std::string& name, FragmentShaderId id, const ShaderParams& params) {
                    const FragmentInput in = MakeFragmentInput(view, 0, false, false);
                    const bool equal = Shaded(id, in, params, kQuarters, 0) == Shaded(id, in, params, {1, 0, 0}, 1);
                    (equal ? same : varying) += 1;
                    EXPECT_TRUE(equal || !SameForTriangle(id, in)) << name;
                  });
    EXPECT_GT(same, 4);
    EXPECT_GT(varying, attributes ? 4 : 1);
  }
}

TEST(NeedsPlaneTest, IsSaidOfShadersThatReadTheGeometry) {
  ForEachShader(true,
                [&](const MeshView& view, const std::string& name, FragmentShaderId id, const ShaderParams& params) {
                  const bool equal = Shaded(id, MakePlainInput(view, 0), params, kQuarters, 0) ==
                                     Shaded(id, MakeFragmentInput(view, 0, false, false), params, kQuarters, 0);
                  EXPECT_TRUE(equal || TraitsOf(id).needs_plane) << name;
                });
  EXPECT_FALSE(TraitsOf(FragmentShaderId::kTriangleId).needs_plane);
  EXPECT_TRUE(TraitsOf(FragmentShaderId::kGeometricNormal).needs_plane);
}

TEST(MaterialIdTest, IsTheIndexInTheFile) {
  ShadingScene scene;
  scene.part.material = 1;
  EXPECT_EQ(ShadeOne(scene.View(), {"material_id", {}}, kQuarters).u[0], 1u);
}

TEST(MeshIdTest, IsTheIndexInTheFile) {
  ShadingScene scene;
  scene.part.mesh = 7;
  EXPECT_EQ(ShadeOne(scene.View(), {"mesh_id", {}}, kQuarters).u[0], 7u);
}

TEST(UvTest, InterpolatesTheSetAskedFor) {
  ShadingScene scene;
  const Vec2f first[3] = {{0, 0}, {1, 0}, {0, 8}}, second[3] = {{-4, 3}, {-4, 3}, {-4, 3}};
  MeshView view = scene.View();
  view.uv[0] = first;
  view.uv[1] = second;
  EXPECT_EQ(Floats(ShadeOne(view, {"uv", {}}, kQuarters)), (Vec4f{0, 0, 0, 1}));  // the part has none
  scene.part.has_uv[0] = scene.part.has_uv[1] = true;
  EXPECT_EQ(Floats(ShadeOne(view, {"uv", {}}, kQuarters)), (Vec4f{0.25f, 4, 0, 1}));
  EXPECT_EQ(Floats(ShadeOne(view, {"uv", {{"set", {1}}}}, kQuarters)), (Vec4f{-4, 3, 0, 1}));
}

TEST(ColorTest, IsWhiteWithoutVertexColours) {
  ShadingScene scene;
  const Vec4f colors[3] = {{1, 0, 0, 1}, {0, 1, 0, 0}, {0, 0, 1, 0.5f}};
  MeshView view = scene.View();
  view.colors = colors;
  EXPECT_EQ(Floats(ShadeOne(view, {"color", {}}, kQuarters)), (Vec4f{1, 1, 1, 1}));
  scene.part.has_colors = true;
  EXPECT_EQ(Floats(ShadeOne(view, {"color", {}}, kQuarters)), (Vec4f{0.25f, 0.25f, 0.5f, 0.5f}));
}

TEST(AttributeTest, InterpolatesAsManyComponentsAsThereAre) {
  const ShadingScene scene;
  const float heat[3] = {4, 8, -2}, flow[6] = {1, 0, 0, 1, 2, 2};
  const AttributeView attributes[2] = {{heat, 1}, {flow, 2}};
  MeshView view = scene.View();
  view.attributes = attributes;
  view.attribute_count = 2;
  FragmentInput in = MakeFragmentInput(view, 0, false, false);
  in.barycentric = kQuarters;
  const auto shade = [&](double slot) {
    FragmentOutput out;
    ShaderParams params;
    params.value[0] = slot;
    ShadeFragment(FragmentShaderId::kAttribute, in, params, out);
    return Floats(out);
  };
  EXPECT_EQ(shade(1), (Vec4f{2, 0, 0, 1}));
  EXPECT_EQ(shade(2), (Vec4f{1.25f, 1.25f, 0, 1}));
  EXPECT_EQ(shade(0), (Vec4f{0, 0, 0, 1}));
  EXPECT_EQ(shade(3), (Vec4f{0, 0, 0, 1}));
}

TEST(AttributeTest, ARunResolvesTheNameAndAnUnknownOneListsThoseOfTheMesh) {
  TriangleMesh mesh = testing::MakeMesh({{0, 0, 0.5}, {8, 0, 0.5}, {0, 8, 0.5}}, {{0, 1, 2}});
  VoxelizeRequest request;
  request.grid = testing::UnitGrid(1, 1, 1);
  TargetSpec target = testing::FloatTarget(4, Blend::kReplace, {"attribute", {}, {{"name", "_HEAT"}}});
  request.targets = {target};
  EXPECT_THAT(std::string(testing::RunError(mesh, request).message()), ::testing::HasSubstr("none of its own"));
  mesh.attributes = {{"_OTHER", 1, {7, 7, 7}}, {"_HEAT", 2, {1, 0, 0, 16, 0, 0}}};
  const VoxelizeResult result = testing::RunPipeline(mesh, request);
  EXPECT_EQ(testing::FloatAt(result.targets[0], 0), 0.875f);  // the voxel's centre has weights 14/16, 1/16, 1/16
  EXPECT_EQ(testing::FloatAt(result.targets[0], 1), 1);
  EXPECT_EQ(testing::FloatAt(result.targets[0], 2), 0);
  EXPECT_EQ(testing::FloatAt(result.targets[0], 3), 1);
  request.targets.push_back(target);
  request.targets[1].shader.text["name"] = "_heat";
  const absl::Status unknown = testing::RunError(mesh, request);
  EXPECT_EQ(unknown.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(unknown.message()), ::testing::HasSubstr("targets[1].shader"));
  EXPECT_THAT(std::string(unknown.message()), ::testing::HasSubstr("'_heat' (it has _OTHER, _HEAT)"));
}

TEST(TangentTest, IsAUnitVectorWithHandedness) {
  ShadingScene scene;
  Vec4f tangents[3] = {{1, 0, 0, -1}, {1, 0, 0, -1}, {0, 1, 0, -1}};
  MeshView view = scene.View();
  view.tangents = tangents;
  EXPECT_EQ(Floats(ShadeOne(view, {"tangent", {}}, kQuarters)), (Vec4f{0, 0, 0, 1}));
  scene.part.has_tangents = true;
  const float half = float(std::sqrt(0.5));
  EXPECT_EQ(Floats(ShadeOne(view, {"tangent", {}}, kQuarters)), (Vec4f{half, half, 0, -1}));
  tangents[2] = {-1, 0, 0, -1};  // they cancel out
  EXPECT_EQ(Floats(ShadeOne(view, {"tangent", {}}, kQuarters)), (Vec4f{0, 0, 0, -1}));
}

TEST(VelocityTest, InterpolatesOrRests) {
  ShadingScene scene;
  const Vec3f velocities[3] = {{4, 0, 0}, {0, 8, 0}, {0, 0, -2}};
  MeshView view = scene.View();
  EXPECT_EQ(Floats(ShadeOne(view, {"velocity", {}}, kQuarters)), (Vec4f{0, 0, 0, 1}));
  view.velocities = velocities;
  EXPECT_EQ(Floats(ShadeOne(view, {"velocity", {}}, kQuarters)), (Vec4f{1, 2, -1, 1}));
}

TEST(PositionTest, LiesOnTheTriangleInTheWorld) {
  ShadingScene scene;
  EXPECT_EQ(Floats(ShadeOne(scene.View(), {"position", {}}, kQuarters)), (Vec4f{1, 2, 0, 1}));
}

TEST(PositionTest, WeightsThatMissOneByARoundingDoNotMoveAFarMesh) {
  ShadingScene scene;
  for (Vec3d& p : scene.positions) p = {1e6, 1e6, 1e6};
  const float third = 1.0f / 3;
  EXPECT_EQ(Floats(ShadeOne(scene.View(), {"position", {}}, {third, third, third})), (Vec4f{1e6f, 1e6f, 1e6f, 1}));
}

TEST(CheckerTest, NeighboursAcrossAFaceDiffer) {
  const ShadingScene scene;
  const auto at = [&](int x, int y, int z) {
    const ShaderCall call{"checker", {{"size", {2}}, {"even", {5}}, {"odd", {-3}}}};
    return ShadeOne(scene.View(), call, kQuarters, {x, y, z}).f[0];
  };
  EXPECT_EQ(at(0, 0, 0), 5);
  EXPECT_EQ(at(1, 1, 1), 5);
  EXPECT_EQ(at(2, 1, 1), -3);
  EXPECT_EQ(at(1, 2, 1), -3);
  EXPECT_EQ(at(1, 1, 2), -3);
  EXPECT_EQ(at(2, 3, 1), 5);
  EXPECT_EQ(at(2, 3, 3), -3);
}

float Fraction(const ShadingScene& scene, const Vec3i& voxel, bool degenerate = false) {
  return ShadeOne(scene.View(), {"coverage_fraction", {}}, kQuarters, voxel, degenerate).f[0];
}

TEST(CoverageFractionTest, IsOneWhereThePlaneFillsTheVoxel) {
  ShadingScene scene;
  for (Vec3d& p : scene.positions) p.z = 0.5;
  EXPECT_EQ(Fraction(scene, {0, 0, 0}), 1);
  EXPECT_EQ(Fraction(scene, {1, 1, 0}), 1);
  EXPECT_EQ(Fraction(scene, {3, 0, 0}), 0.5f);  // cut by the hypotenuse
  EXPECT_EQ(Fraction(scene, {2, 2, 0}), 0);     // touched in one point
  EXPECT_EQ(Fraction(scene, {0, 0, 1}), 0);
  EXPECT_EQ(Fraction(scene, {0, 0, 0}, true), 0);
}

// Otherwise the faces of a box on the voxels' borders count twice.
TEST(CoverageFractionTest, ATriangleInASharedFaceCountsInTheVoxelBehindIt) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const bool turned : {false, true}) {
      for (const int at : {0, 3, 8}) {  // the grid has 8 voxels
        ShadingScene scene;
        for (Vec3d& p : scene.positions) {  // normals point up along the axis, unless turned
          const Vec3d flat = p;
          p[axis] = at;
          p[(axis + 1) % 3] = flat.x;
          p[(axis + 2) % 3] = flat.y;
        }
        if (turned) std::swap(scene.positions[1], scene.positions[2]);
        Vec3i below{1, 1, 1}, above{1, 1, 1};
        below[axis] = at - 1;
        above[axis] = at;
        const bool counts_below = at == 8 || (at != 0 && !turned);
        if (at != 0) {
          EXPECT_EQ(Fraction(scene, below), counts_below ? 1 : 0) << axis << turned << at;
        }
        if (at != 8) {
          EXPECT_EQ(Fraction(scene, above), counts_below ? 0 : 1) << axis << turned << at;
        }
      }
    }
  }
}

TEST(CoverageFractionTest, CutsTheHexagonAndTheDiagonalRectangle) {
  ShadingScene scene;
  const Vec3d hexagon[3] = {{1.5 + 9, 0 - 4.5, 0 - 4.5}, {0 - 4.5, 1.5 + 9, 0 - 4.5}, {0 - 4.5, 0 - 4.5, 1.5 + 9}};
  std::copy(hexagon, hexagon + 3, scene.positions);  // x + y + z = 1.5
  EXPECT_NEAR(Fraction(scene, {0, 0, 0}), 3 * std::sqrt(3.0) / 4, 1e-7);
  const Vec3d diagonal[3] = {{-9, -9, -20}, {20, 20, -20}, {0.5, 0.5, 40}};
  std::copy(diagonal, diagonal + 3, scene.positions);  // x = y
  EXPECT_NEAR(Fraction(scene, {0, 0, 0}), std::sqrt(2.0), 1e-7);
}

TEST(CoverageFractionTest, PartsSumToTheTriangle) {
  ShadingScene scene;
  const Vec3d skew[3] = {{0.3, 0.2, 0.7}, {5.1, 2.9, 1.4}, {1.7, 4.6, 5.8}};
  std::copy(skew, skew + 3, scene.positions);
  double sum = 0;
  for (int z = 0; z < 6; ++z) {
    for (int y = 0; y < 6; ++y) {
      for (int x = 0; x < 6; ++x) sum += Fraction(scene, {x, y, z});
    }
  }
  const Vec3d n = Cross(skew[1] - skew[0], skew[2] - skew[0]);
  EXPECT_NEAR(sum, 0.5 * std::sqrt(Dot(n, n)), 1e-5);
}

TEST(UvDensityTest, IsTheMeanStretchFromVoxelsToTexels) {
  const Vec3d a{0, 0, 0}, b{4, 0, 0}, c{0, 4, 0};
  EXPECT_EQ(UvDensity(a, b, c, {0, 0}, {1, 0}, {0, 1}), 0.25f);
  EXPECT_EQ(UvDensity(a, b, c, {0, 0}, {1, 0}, {0, 4}), 0.5f);  // stretched 4:1
  EXPECT_EQ(UvDensity(a, b, c, {0, 0}, {1, 1}, {2, 2}), 0);     // no area
  EXPECT_EQ(UvDensity(a, a, c, {0, 0}, {1, 0}, {0, 1}), 0);
  EXPECT_EQ(UvDensity(a, b, c, {NAN, 0}, {1, 0}, {0, 1}), 0);
  EXPECT_EQ(UvDensity(a, b, c, {0, 0}, {3e38f, 0}, {0, 3e38f}), 0x1p60f);
}

}  // namespace
}  // namespace voxelpipe
