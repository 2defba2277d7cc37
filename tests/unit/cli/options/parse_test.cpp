#include "options/parse.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

namespace voxelpipe::cli {
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

TEST(ParseShaderCall, ReadsTextParametersByNameOrInBrackets) {
  const ShaderCall heat{"attribute", {}, {{"name", "_HEAT"}}};
  EXPECT_EQ(ParseShaderCall("attribute:name=_HEAT").value(), heat);
  EXPECT_EQ(ParseShaderCall("attribute(_HEAT)").value(), heat);
  EXPECT_EQ(ParseTarget("f32:max:shader=attribute(_HEAT)", {}).value().shader, heat);
  EXPECT_EQ(ParseTarget("f32:max:name=_HEAT,shader=attribute", {}).value().shader, heat);
  EXPECT_EQ(ParseTarget("f32:max", heat).value().shader, heat);
  EXPECT_EQ(ParseTarget("f32:max:name=_HEAT", {"attribute", {}, {{"name", "_COLD"}}}).value().shader, heat);
  EXPECT_THAT(Error(ParseShaderCall("attribute(_HEAT").status()), HasSubstr("name(text)"));
  EXPECT_THAT(Error(ParseShaderCall("attribute()").status()), HasSubstr("name(text)"));
  EXPECT_THAT(Error(ParseShaderCall("normal(x)").status()), HasSubstr("nothing in brackets"));
  EXPECT_THAT(Error(ParseShaderCall("attribute(_A):name=_B").status()), HasSubstr("twice"));
}

TEST(ParseShaderCall, ReadsNameAndParameters) {
  EXPECT_EQ(ParseShaderCall("occupancy").value(), (ShaderCall{"occupancy", {}}));
  EXPECT_EQ(ParseShaderCall("constant:value=0.5/0.2/1").value(), (ShaderCall{"constant", {{"value", {0.5, 0.2, 1}}}}));
  EXPECT_EQ(ParseShaderCall("s:a=1,b=2/3").value(), (ShaderCall{"s", {{"a", {1}}, {"b", {2, 3}}}}));
  EXPECT_THAT(Error(ParseShaderCall("").status()), HasSubstr("names no shader"));
  EXPECT_THAT(Error(ParseShaderCall(":a=1").status()), HasSubstr("names no shader"));
  EXPECT_THAT(Error(ParseShaderCall("s:").status()), HasSubstr("name=value"));
  EXPECT_THAT(Error(ParseShaderCall("s:a").status()), HasSubstr("'a'"));
  EXPECT_THAT(Error(ParseShaderCall("s:=1").status()), HasSubstr("'=1'"));
  EXPECT_THAT(Error(ParseShaderCall("s:a=").status()), HasSubstr("'a='"));
  EXPECT_THAT(Error(ParseShaderCall("s:a=1,a=2").status()), HasSubstr("twice"));
  EXPECT_THAT(Error(ParseShaderCall("s:a=x").status()), HasSubstr("a: 'x' is not a number"));
}

TEST(ParseTarget, ReadsFormatComponentsAndBlend) {
  const ShaderCall shader{"occupancy", {}};
  const TargetSpec bit = ParseTarget("bit:or", shader).value();
  EXPECT_EQ(bit.format, VoxelFormat::kBit);
  EXPECT_EQ(bit.components, 1);
  EXPECT_EQ(bit.blend, Blend::kOr);
  EXPECT_EQ(bit.shader, shader);
  EXPECT_EQ(bit.quantum, TargetSpec{}.quantum);
  EXPECT_EQ(bit.clear, 0);
  EXPECT_TRUE(bit.fill_values.empty());
  for (int components = 1; components <= 4; ++components) {
    const TargetSpec target = ParseTarget("f32x" + std::to_string(components) + ":max", shader).value();
    EXPECT_EQ(target.format, VoxelFormat::kF32);
    EXPECT_EQ(target.components, components);
    EXPECT_EQ(target.blend, Blend::kMax);
  }
  EXPECT_EQ(ParseTarget("f32:add", shader).value().components, 1);
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

TEST(ParseTarget, ReadsEncodingAndFillNumbers) {
  const ShaderCall shader{"base_color", {}};
  const TargetSpec target = ParseTarget("u8:average:encoding=srgb,fill=1/20/255/0.5", shader).value();
  EXPECT_EQ(target.encoding, Encoding::kSrgb);
  EXPECT_THAT(target.fill_values, ElementsAre(1, 20, 255, 0.5));
  EXPECT_EQ(ParseTarget("u8:max:encoding=linear", shader).value().encoding, Encoding::kLinear);
  EXPECT_EQ(ParseTarget("u16:max:encoding=snorm", {"normal", {}}).value().encoding, Encoding::kSnorm);
  EXPECT_THAT(Error(ParseTarget("u8:max:encoding=sRGB", shader).status()), HasSubstr("encoding: 'sRGB'"));
  EXPECT_THAT(Error(ParseTarget("u8:max:fill=1/x", shader).status()), HasSubstr("fill: 'x'"));
}

TEST(ParseTarget, ReadsItsOptionsAndItsShadersParameters) {
  const TargetSpec target =
      ParseTarget("f32x3:add:shader=constant,quantum=0.25,clear=-1,fill=7,value=1/2/3", {"occupancy", {}}).value();
  EXPECT_EQ(target.shader, (ShaderCall{"constant", {{"value", {1, 2, 3}}}}));
  EXPECT_EQ(target.quantum, 0.25);
  EXPECT_EQ(target.clear, -1);
  EXPECT_EQ(target.fill_values, std::vector<double>{7});
  EXPECT_EQ(ParseTarget("f32:max:clear=-inf", {"occupancy", {}}).value().clear,
            -std::numeric_limits<double>::infinity());
}

TEST(ParseTarget, LaysItsParametersOverTheDefaultShader) {
  const ShaderCall shader{"constant", {{"value", {1}}, {"other", {4}}}};
  EXPECT_EQ(ParseTarget("f32:add:value=2", shader).value().shader,
            (ShaderCall{"constant", {{"value", {2}}, {"other", {4}}}}));
  // A shader of its own starts from nothing.
  EXPECT_EQ(ParseTarget("f32:add:shader=normal", shader).value().shader, (ShaderCall{"normal", {}}));
}

TEST(ParseTarget, NamesWhatIsWrong) {
  const ShaderCall shader{"occupancy", {}};
  EXPECT_THAT(Error(ParseTarget("bit", shader).status()), HasSubstr("FORMAT[xC]:BLEND"));
  EXPECT_THAT(Error(ParseTarget("u7:or", shader).status()), HasSubstr("unknown format 'u7'"));
  EXPECT_THAT(Error(ParseTarget("f32x:add", shader).status()), HasSubstr("1 to 4"));
  EXPECT_THAT(Error(ParseTarget("f32x5:add", shader).status()), HasSubstr("1 to 4"));
  EXPECT_THAT(Error(ParseTarget("f32x0:add", shader).status()), HasSubstr("1 to 4"));
  EXPECT_THAT(Error(ParseTarget("f32:xor", shader).status()), HasSubstr("unknown blend 'xor'"));
  EXPECT_EQ(ParseTarget("u16x2:average:scale=2", shader).value().scale, 2.0);
  EXPECT_THAT(Error(ParseTarget("u8:add:scale=x", shader).status()), HasSubstr("scale: 'x'"));
  EXPECT_THAT(Error(ParseTarget("f32:add:clear=x", shader).status()), HasSubstr("clear: 'x'"));
  EXPECT_THAT(Error(ParseTarget("f32:add:", shader).status()), HasSubstr("name=value"));
  EXPECT_THAT(Error(ParseTarget("", shader).status()), HasSubstr("FORMAT[xC]:BLEND"));
}

TEST(ResolveTargets, DefaultsToBitsOfOccupancy) {
  for (const std::optional<std::string>& shader :
       {std::optional<std::string>(), std::optional<std::string>("occupancy")}) {
    const std::vector<TargetSpec> targets = ResolveTargets({}, shader).value();
    ASSERT_EQ(targets.size(), 1u);
    EXPECT_EQ(targets[0].format, VoxelFormat::kBit);
    EXPECT_EQ(targets[0].blend, Blend::kOr);
    EXPECT_EQ(targets[0].shader, (ShaderCall{"occupancy", {}}));
  }
}

TEST(ResolveTargets, GivesAnotherShaderAsManyFloatsAsItHas) {
  const std::vector<std::pair<std::string, int>> shaders = {
      {"normal", 3}, {"base_color", 4}, {"triangle_id", 1}, {"barycentric", 3}};
  for (const auto& [shader, components] : shaders) {
    const std::vector<TargetSpec> targets = ResolveTargets({}, shader).value();
    ASSERT_EQ(targets.size(), 1u);
    EXPECT_EQ(targets[0].format, VoxelFormat::kF32) << shader;
    EXPECT_EQ(targets[0].components, components) << shader;
    EXPECT_EQ(targets[0].blend, Blend::kReplace) << shader;
    EXPECT_EQ(targets[0].shader.name, shader);
  }
  EXPECT_THAT(Error(ResolveTargets({}, "no_such_shader").status()), HasSubstr("no_such_shader"));
}

TEST(ResolveTargets, KeepsTheOrderOfSeveral) {
  const std::vector<TargetSpec> targets =
      ResolveTargets({"bit:or", "f32x3:replace:shader=normal", "f32:add"}, "constant:value=2").value();
  ASSERT_EQ(targets.size(), 3u);
  EXPECT_EQ(targets[0].shader, (ShaderCall{"constant", {{"value", {2}}}}));
  EXPECT_EQ(targets[1].shader, (ShaderCall{"normal", {}}));
  EXPECT_EQ(targets[2].shader, (ShaderCall{"constant", {{"value", {2}}}}));
}

}  // namespace
}  // namespace voxelpipe::cli
