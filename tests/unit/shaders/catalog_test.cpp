#include "shaders/catalog.h"

#include <limits>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "shaders/shader_list.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;

// "GeometricNormal" -> "geometric_normal".
std::string SnakeCase(std::string_view pascal) {
  std::string snake;
  for (const char c : pascal) {
    if (std::isupper(c) != 0 && !snake.empty()) snake += '_';
    snake += char(std::tolower(c));
  }
  return snake;
}

TEST(CatalogTest, ListsEveryShaderInTheOrderOfTheList) {
  std::vector<std::string> expected;
#define VOXELPIPE_NAME(name) expected.push_back(SnakeCase(#name));
  VOXELPIPE_VERTEX_SHADERS(VOXELPIPE_NAME)
  VOXELPIPE_FRAGMENT_SHADERS(VOXELPIPE_NAME)
#undef VOXELPIPE_NAME
  std::vector<std::string> listed;
  for (const ShaderInfo& info : ListShaders()) {
    listed.push_back(info.name);
    EXPECT_FALSE(info.description.empty());
  }
  EXPECT_EQ(listed, expected);
}

TEST(CatalogTest, BindsIdsOfTheEnumeration) {
  const auto normal = BindShader(ShaderStage::kFragment, {"packed_normal", {}});
  ASSERT_TRUE(normal.ok());
  EXPECT_EQ(FragmentShaderId(normal->id), FragmentShaderId::kPackedNormal);
  const auto transform = BindShader(ShaderStage::kVertex, {"transform", {}});
  ASSERT_TRUE(transform.ok());
  EXPECT_EQ(VertexShaderId(transform->id), VertexShaderId::kTransform);
  EXPECT_EQ(transform->params.value[5], 1);  // the default is the identity
}

TEST(CatalogTest, ShadersThatCanDiscardDoSoWithAnAlphaMaskAlone) {
  MaterialView opaque, masked;
  masked.alpha_mask = true;
#define VOXELPIPE_CHECK(name)                                           \
  EXPECT_FALSE(MayDiscard(FragmentShaderId::k##name, opaque)) << #name; \
  EXPECT_EQ(MayDiscard(FragmentShaderId::k##name, masked), TraitsOf(FragmentShaderId::k##name).can_discard) << #name;
  VOXELPIPE_FRAGMENT_SHADERS(VOXELPIPE_CHECK)
#undef VOXELPIPE_CHECK
}

TEST(CatalogTest, MissingComponentsAreZeroTheFourthOne) {
  const auto one = BindShader(ShaderStage::kFragment, {"constant", {{"value", {0.25}}}});
  ASSERT_TRUE(one.ok());
  EXPECT_EQ(one->params.value[0], 0.25);
  EXPECT_EQ(one->params.value[2], 0);
  EXPECT_EQ(one->params.value[3], 1);
}

TEST(CatalogTest, NamesWhatIsWrong) {
  const auto message = [](ShaderStage stage, const ShaderCall& call) {
    const auto bound = BindShader(stage, call);
    EXPECT_EQ(bound.status().code(), absl::StatusCode::kInvalidArgument);
    return std::string(bound.status().message());
  };
  EXPECT_THAT(message(ShaderStage::kFragment, {"phong", {}}), HasSubstr("'phong' (known: occupancy"));
  EXPECT_THAT(message(ShaderStage::kVertex, {"occupancy", {}}), HasSubstr("no vertex shader 'occupancy'"));
  EXPECT_THAT(message(ShaderStage::kFragment, {"constant", {{"colour", {1}}}}), HasSubstr("no parameter 'colour'"));
  EXPECT_THAT(message(ShaderStage::kFragment, {"constant", {{"value", {1, 2, 3, 4, 5}}}}), HasSubstr("1 to 4 numbers"));
  EXPECT_THAT(message(ShaderStage::kVertex, {"transform", {{"matrix", {1, 2}}}}), HasSubstr("16 numbers, 2 given"));
  EXPECT_THAT(message(ShaderStage::kVertex, {"transform", {{"matrix", std::vector<double>(16, 1)}}}),
              HasSubstr("last row"));
  EXPECT_THAT(message(ShaderStage::kFragment, {"attribute", {}}), HasSubstr("'name' must be given as text"));
  EXPECT_THAT(message(ShaderStage::kFragment, {"attribute", {{"name", {1}}}}), HasSubstr("must be given as text"));
  EXPECT_THAT(message(ShaderStage::kFragment, {"uv", {}, {{"set", "1"}}}), HasSubstr("'set' takes numbers, '1' given"));
  EXPECT_THAT(message(ShaderStage::kFragment, {"uv", {{"set", {2}}}}), HasSubstr("whole number from 0 to 1, 2 given"));
  EXPECT_THAT(message(ShaderStage::kFragment, {"checker", {{"size", {0}}}}), HasSubstr("from 1 to"));
  EXPECT_THAT(message(ShaderStage::kFragment, {"checker", {{"size", {2.5}}}}), HasSubstr("whole number"));
  EXPECT_THAT(message(ShaderStage::kFragment, {"constant", {{"value", {std::numeric_limits<double>::infinity()}}}}),
              HasSubstr("finite"));
}

}  // namespace
}  // namespace voxelpipe
