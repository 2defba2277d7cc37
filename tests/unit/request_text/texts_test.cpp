// Numbers, and the targets of a request. Texts of shaders and targets: request_cases.json.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "request_text/numbers.h"
#include "request_text/target_text.h"

namespace voxelpipe {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

std::string Error(const absl::Status& status) {
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  return std::string(status.message());
}

TEST(ParseNumbers, ReadsEveryPart) {
  EXPECT_THAT(ParseNumbers("1", '/').value(), ElementsAre(1));
  EXPECT_THAT(ParseNumbers("-1/0.5/2e3", '/').value(), ElementsAre(-1, 0.5, 2000));
  for (const char* bad : {"", "1/", "/1", "1//2", "1,2", "1x", "nan", "0x", "one"}) {
    EXPECT_THAT(Error(ParseNumbers(bad, '/').status()), HasSubstr("is not a number")) << bad;
  }
}

TEST(ParseVoxelSize, TakesOneOrThreePositiveNumbers) {
  EXPECT_EQ(ParseVoxelSize("0.25").value(), (Vec3d{0.25, 0.25, 0.25}));
  EXPECT_EQ(ParseVoxelSize("1,2,3").value(), (Vec3d{1, 2, 3}));
  for (const char* bad : {"0", "-1", "1,2", "1,2,3,4", "1,0,1", "inf", "1,inf,1", ""})
    EXPECT_FALSE(ParseVoxelSize(bad).ok()) << bad;
}

TEST(ParsePoint, TakesThreeFiniteNumbers) {
  EXPECT_EQ(ParsePoint("-1,0.5,2").value(), (Vec3d{-1, 0.5, 2}));
  for (const char* bad : {"1", "1,2", "1,2,inf", "1,2,x"}) EXPECT_FALSE(ParsePoint(bad).ok()) << bad;
}

TEST(ParseDims, TakesThreeWholeNumbers) {
  EXPECT_THAT(ParseDims("1,20,300").value(), ElementsAre(1, 20, 300));
  for (const char* bad :
       {"1", "1,2", "1,2,3,4", "1,2,0", "1,-2,3", "1,2.5,3", "1,2,99999999999999999999", "1,,3", "1, 2,3"}) {
    EXPECT_FALSE(ParseDims(bad).ok()) << bad;
  }
}

TEST(ParseTarget, HasItsShadersOwnComponentsWhereNoneAreGiven) {
  const ShaderCall shader{"normal", {}};
  EXPECT_EQ(ParseTarget("f32:add", shader).value().components, 3);
  EXPECT_EQ(ParseTarget("u8:max:shader=base_color", shader).value().components, 4);
  EXPECT_EQ(ParseTarget("f16:replace:shader=attribute(_HEAT)", shader).value().components, 4);
  EXPECT_EQ(ParseTarget("f32:replace:shader=uv", shader).value().components, 2);
  EXPECT_EQ(ParseTarget("u32:max:shader=triangle_id", shader).value().components, 1);
  EXPECT_EQ(ParseTarget("bit:or", shader).value().components, 1);
  EXPECT_EQ(ParseTarget("u32:count", shader).value().components, 1);
  EXPECT_EQ(ParseTarget("f32x1:add", shader).value().components, 1);
  EXPECT_EQ(ParseTarget("f32:add:shader=no_such_shader", shader).value().components, 1);
}

TEST(ParseTargets, DefaultsToBitsOfOccupancy) {
  for (const std::optional<std::string>& shader :
       {std::optional<std::string>(), std::optional<std::string>("occupancy")}) {
    const std::vector<TargetSpec> targets = ParseTargets({}, shader).value();
    ASSERT_EQ(targets.size(), 1u);
    EXPECT_EQ(targets[0].format, VoxelFormat::kBit);
    EXPECT_EQ(targets[0].blend, Blend::kOr);
    EXPECT_EQ(targets[0].shader, (ShaderCall{"occupancy", {}}));
  }
}

TEST(ParseTargets, GivesAnotherShaderAsManyFloatsAsItHas) {
  const std::vector<std::pair<std::string, int>> shaders = {
      {"normal", 3}, {"base_color", 4}, {"triangle_id", 1}, {"barycentric", 3}};
  for (const auto& [shader, components] : shaders) {
    const std::vector<TargetSpec> targets = ParseTargets({}, shader).value();
    ASSERT_EQ(targets.size(), 1u);
    EXPECT_EQ(targets[0].format, VoxelFormat::kF32) << shader;
    EXPECT_EQ(targets[0].components, components) << shader;
    EXPECT_EQ(targets[0].blend, Blend::kReplace) << shader;
    EXPECT_EQ(targets[0].shader.name, shader);
  }
  EXPECT_THAT(Error(ParseTargets({}, "no_such_shader").status()), HasSubstr("no_such_shader"));
}

TEST(ParseTargets, KeepsTheOrderOfSeveral) {
  const std::vector<TargetSpec> targets =
      ParseTargets({"bit:or", "f32x3:replace:shader=normal", "f32:add"}, "constant:value=2").value();
  ASSERT_EQ(targets.size(), 3u);
  EXPECT_EQ(targets[0].shader, (ShaderCall{"constant", {{"value", {2}}}}));
  EXPECT_EQ(targets[1].shader, (ShaderCall{"normal", {}}));
  EXPECT_EQ(targets[2].shader, (ShaderCall{"constant", {{"value", {2}}}}));
}

}  // namespace
}  // namespace voxelpipe
