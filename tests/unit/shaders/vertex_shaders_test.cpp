#include <cmath>

#include "gtest/gtest.h"
#include "shaders/catalog.h"
#include "shaders/shader_list.h"

namespace voxelpipe {
namespace {

ShadedVertex Shade(const ShaderCall& call, const ShadedVertex& flat) {
  const auto bound = BindShader(ShaderStage::kVertex, call);
  EXPECT_TRUE(bound.ok()) << bound.status();
  if (!bound.ok()) return {};
  VertexInput in;
  in.flat = flat;
  return ShadeVertex(VertexShaderId(bound->id), in, bound->params);
}

ShadedVertex Flat() {
  ShadedVertex v;
  v.position = {1, 2, 3};
  v.normal = {0, 0, 1};
  v.tangent = {1, 0, 0, 1};
  return v;
}

TEST(VertexShadersTest, DisplacementGoesAlongTheNormalInWorldUnits) {
  EXPECT_EQ(Shade({"displace_along_normal", {{"distance", {0.5}}}}, Flat()).position, (Vec3d{1, 2, 3.5}));
  EXPECT_EQ(Shade({"displace_along_normal", {{"distance", {-2}}}}, Flat()).position, (Vec3d{1, 2, 1}));
  ShadedVertex bare = Flat();
  bare.normal = {};
  EXPECT_EQ(Shade({"displace_along_normal", {{"distance", {0.5}}}}, bare).position, bare.position);
}

TEST(VertexShadersTest, RigidMotionIsLinearPlusAngularCrossTheArm) {
  for (const char* name : {"identity", "transform", "displace_along_normal", "morph", "skin"}) {
    const ShadedVertex v = Shade(
        {name, {{"linear_velocity", {10, 20, 30}}, {"angular_velocity", {0, 0, 2}}, {"center", {0, 1, 0}}}}, Flat());
    // w x r = (0,0,2) x (1,1,3) = (-2, 2, 0)
    EXPECT_EQ(v.velocity, (Vec3d{8, 22, 30})) << name;
    EXPECT_EQ(v.position, (Vec3d{1, 2, 3})) << name;
  }
}

TEST(VertexShadersTest, RigidMotionTurnsAboutTheShadedPosition) {
  const ShadedVertex v = Shade({"displace_along_normal", {{"distance", {1}}, {"angular_velocity", {1, 0, 0}}}}, Flat());
  EXPECT_EQ(v.velocity, (Vec3d{0, -4, 2}));  // (1,0,0) x (1,2,4)
}

TEST(VertexShadersTest, TransformFromThePreviousMatrixGivesVelocity) {
  const std::vector<double> now = {1, 0, 0, 3, 0, 1, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1};
  const ShadedVertex v = Shade({"transform", {{"matrix", now}, {"dt", {0.5}}}}, Flat());
  EXPECT_EQ(v.position, (Vec3d{4, 2, 6}));
  EXPECT_EQ(v.velocity, (Vec3d{6, 0, 6}));  // previous: the identity
  EXPECT_EQ(Shade({"transform", {{"matrix", now}}}, Flat()).velocity, (Vec3d{0, 0, 0}));
}

TEST(VertexShadersTest, TransformTurnsTangentsAndMirroringFlipsTheirHandedness) {
  const std::vector<double> quarter = {0, -2, 0, 0, 2, 0, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1};
  EXPECT_EQ(Shade({"transform", {{"matrix", quarter}}}, Flat()).tangent, (Vec4f{0, 1, 0, 1}));
  const std::vector<double> mirror = {1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
  EXPECT_EQ(Shade({"transform", {{"matrix", mirror}}}, Flat()).tangent, (Vec4f{1, 0, 0, -1}));
}

TEST(VertexShadersTest, TransformKeepsNormalsOnTheirSideOfTheSurfaceInAMirrorToo) {
  const std::vector<double> mirror = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1};
  EXPECT_EQ(Shade({"transform", {{"matrix", mirror}}}, Flat()).normal, (Vec3f{0, 0, -1}));
  const std::vector<double> swap = {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1};
  EXPECT_EQ(Shade({"transform", {{"matrix", swap}}}, Flat()).normal, (Vec3f{1, 0, 0}));
}

TEST(VertexShadersTest, PoseMorphsThenSkinsWithNormalizedWeights) {
  const Vec3f positions[1] = {{1, 0, 0}}, delta[1] = {{0, 2, 0}};
  const Vec3f normals[1] = {{0, 0, 1}};
  const uint16_t joints[1][4] = {{0, 1, 0, 0}};
  const float weights[1][4] = {{0.5f, 1.5f, 0, 0}};  // sum to 2: normalized to 1/4 and 3/4
  MorphTargetView target;
  target.positions = delta;
  RestPrimitiveView rest;
  rest.positions = positions;
  rest.normals = normals;
  rest.joints[0] = joints;
  rest.weights[0] = weights;
  rest.targets = &target;
  rest.target_count = 1;
  Mat4d palette[2];
  palette[1].m[0][3] = 8;
  const double half = 0.5;
  PoseView pose;
  pose.target_weights = &half;
  pose.joints = palette;
  pose.joint_count = 2;
  const ShadedVertex v = PoseVertex(rest, pose, 0);
  EXPECT_EQ(v.position, (Vec3d{7, 1, 0}));
  EXPECT_EQ(v.normal, (Vec3f{0, 0, 1}));
  pose.joint_count = 1;
  EXPECT_TRUE(std::isnan(PoseVertex(rest, pose, 0).position.x));
}

TEST(VertexShadersTest, ListsMayBeOfAnyLengthAndVectorsMustBeThree) {
  EXPECT_TRUE(BindShader(ShaderStage::kVertex, {"morph", {{"weights", {1, 0, 0.5, 0, 1}}}}).ok());
  EXPECT_FALSE(BindShader(ShaderStage::kVertex, {"morph", {{"weights", {NAN}}}}).ok());
  EXPECT_FALSE(BindShader(ShaderStage::kVertex, {"identity", {{"linear_velocity", {1, 2}}}}).ok());
  EXPECT_FALSE(BindShader(ShaderStage::kVertex, {"skin", {{"dt", {-1}}}}).ok());
}

}  // namespace
}  // namespace voxelpipe
