// Signed permutations of axes, and what they do to a vertex shader.
#include "request_text/axes.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "request_text/request_options.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;

Vec3d Turned(const char* axes, const Vec3d& p) {
  return TransformPoint(ParseAxes(axes).value(), p);
}

TEST(Axes, EachPartNamesTheMeshsAxisThatBecomesTheGrids) {
  const Vec3d p{1, 2, 3};
  EXPECT_EQ(Turned("x,y,z", p), p);
  EXPECT_EQ(Turned("x,z,-y", p), (Vec3d{1, 3, -2}));
  EXPECT_EQ(Turned("-y,+x,z", p), (Vec3d{-2, 1, 3}));
}

TEST(Axes, All48SignedPermutationsAreTaken) {
  int count = 0, mirrors = 0;
  for (const char* order : {"xyz", "xzy", "yxz", "yzx", "zxy", "zyx"}) {
    for (int signs = 0; signs < 8; ++signs) {
      std::string text;
      for (int a = 0; a < 3; ++a) {
        text += a > 0 ? "," : "";
        if ((signs >> a & 1) != 0) text += "-";
        text += order[a];
      }
      const auto matrix = ParseAxes(text);
      ASSERT_TRUE(matrix.ok()) << text;
      mirrors += Determinant3(*matrix) == -1;
      ++count;
    }
  }
  EXPECT_EQ(count, 48);
  EXPECT_EQ(mirrors, 24);
}

TEST(Axes, AnythingElseIsRefused) {
  for (const char* text : {"", "x", "x,y", "x,y,z,", "x,y,z,x", "x,x,y", "x,y,-y", "a,b,c", "x y z", "--x,y,z", "x,,z",
                           "X,Y,Z", "1,0,0", "x,y,z ", ",x,y"}) {
    EXPECT_THAT(std::string(ParseAxes(text).status().message()), HasSubstr("as in x,z,-y")) << text;
  }
}

TEST(Axes, IdentityBecomesTransformAndXyzChangesNothing) {
  const ShaderCall identity{"identity", {}};
  EXPECT_EQ(WithAxes(identity, ParseAxes("x,y,z").value()).value(), identity);
  const ShaderCall turned = WithAxes(identity, ParseAxes("x,z,-y").value()).value();
  EXPECT_EQ(turned.name, "transform");
  EXPECT_EQ(turned.parameters.at("matrix"), (std::vector<double>{1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1}));
  EXPECT_EQ(turned.parameters.at("matrix_previous"), turned.parameters.at("matrix"));
}

TEST(Axes, ComeAfterAMatrixThatIsGiven) {
  const std::vector<double> moved = {1, 0, 0, 10, 0, 1, 0, 20, 0, 0, 1, 30, 0, 0, 0, 1};
  const ShaderCall turned =
      WithAxes({"transform", {{"matrix", moved}, {"dt", {0.5}}}}, ParseAxes("x,z,-y").value()).value();
  EXPECT_EQ(turned.parameters.at("matrix"), (std::vector<double>{1, 0, 0, 10, 0, 0, 1, 30, 0, -1, 0, -20, 0, 0, 0, 1}));
  EXPECT_EQ(turned.parameters.at("matrix_previous"),
            (std::vector<double>{1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1}));
  EXPECT_EQ(turned.parameters.at("dt"), std::vector<double>{0.5});
}

// v = linear + angular x (p - center), turned, is the velocity of the turned motion at the turned point.
TEST(Axes, TheRigidMotionTurnsWithTheMeshInAMirrorToo) {
  const ShaderCall call{"identity",
                        {{"linear_velocity", {1, 2, 3}}, {"angular_velocity", {5, 7, 11}}, {"center", {-1, 4, 2}}}};
  const auto velocity = [](const ShaderCall& shader, const Vec3d& p) {
    const auto vector = [&](const char* name) {
      const std::vector<double>& v = shader.parameters.at(name);
      return Vec3d{v[0], v[1], v[2]};
    };
    return vector("linear_velocity") + Cross(vector("angular_velocity"), p - vector("center"));
  };
  const Vec3d p{0.5, -3, 8};
  for (const char* axes : {"x,z,-y", "y,z,x", "x,z,y", "-x,y,z"}) {
    const ShaderCall turned = WithAxes(call, ParseAxes(axes).value()).value();
    EXPECT_EQ(velocity(turned, Turned(axes, p)), Turned(axes, velocity(call, p))) << axes;
  }
}

TEST(Axes, OtherVertexShadersAndWrongParametersAreRefusedByName) {
  RequestOptions options;
  options.axes = "x,z,-y";
  const auto error = [&](const char* shader) {
    options.vertex_shader = shader;
    return std::string(BuildRequest(options).status().message());
  };
  EXPECT_THAT(error("skin:time=0"), HasSubstr("--axes: turns the mesh by the vertex shader transform; 'skin'"));
  EXPECT_THAT(error("displace_along_normal:distance=1"), HasSubstr("leave the axes out"));
  EXPECT_THAT(error("transform:matrix=1/2"), HasSubstr("16 numbers"));
  options.axes = "x,y,z";
  EXPECT_EQ(error("skin:time=0"), "");
  options.axes = "x,y,y";
  EXPECT_THAT(error("identity"), HasSubstr("--axes: 'x,y,y'"));
}

}  // namespace
}  // namespace voxelpipe
