// Vertex attributes of a file's own (_NAME): what the loader keeps, and how it reads them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "load/loader.h"
#include "support/meshes/glb_builder.h"
#include "support/warnings.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::AsBytes;
using testing::ByteVector;
using ::testing::ElementsAre;
using testing::GlbBuilder;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

const std::vector<Vec3f> kTriangle = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};

// A scene of one mesh, a triangle, with these attributes beside its positions.
absl::StatusOr<Scene> LoadWith(GlbBuilder& builder, const json& attributes) {
  json primitive = builder.Primitive(kTriangle);
  for (const auto& [name, accessor] : attributes.items()) primitive["attributes"][name] = accessor;
  builder.Scene({builder.Node({{"mesh", builder.Mesh(primitive)}})});
  return LoadScene(builder.Glb());
}

std::vector<VertexAttribute> Attributes(const absl::StatusOr<Scene>& scene) {
  EXPECT_TRUE(scene.ok()) << scene.status();
  return scene.ok() ? scene->meshes.at(0).primitives.at(0).attributes : std::vector<VertexAttribute>();
}

TEST(GltfOwnAttributes, FloatsOfOneToFourComponents) {
  for (int components = 1; components <= 4; ++components) {
    GlbBuilder builder;
    std::vector<float> values;
    for (int i = 0; i < 3 * components; ++i) values.push_back(float(i) - 1.5f);
    const std::string type = components == 1 ? "SCALAR" : "VEC" + std::to_string(components);
    const auto read = Attributes(LoadWith(builder, {{"_TEMP", builder.Vectors(values, type)}}));
    ASSERT_THAT(read, SizeIs(1));
    EXPECT_EQ(read[0].name, "_TEMP");
    EXPECT_EQ(read[0].components, components);
    EXPECT_EQ(read[0].values, values);
  }
}

TEST(GltfOwnAttributes, IntegersAreFractionsWhereNormalizedAndNumbersElsewhere) {
  struct Case {
    int type;
    ByteVector bytes;
    int stride;
    bool normalized;
    std::vector<float> want;
  };
  const std::vector<Case> cases = {
      {testing::kU8, {255, 0, 0, 0, 51, 0, 0, 0, 0}, 4, true, {1, 0.2f, 0}},
      {testing::kU8, {255, 0, 0, 0, 51, 0, 0, 0, 0}, 4, false, {255, 51, 0}},
      {testing::kI8, {128, 0, 0, 0, 127, 0, 0, 0, 0}, 4, true, {-1, 1, 0}},
      {testing::kI16, AsBytes(std::vector<int16_t>{-32768, 0, 32767, 0, 7}), 4, false, {-32768, 32767, 7}},
      {testing::kU16, AsBytes(std::vector<uint16_t>{65535, 0, 13107, 0, 0}), 4, true, {1, 0.2f, 0}},
      {testing::kU32, AsBytes(std::vector<uint32_t>{4294967295u, 16777216, 3}), 0, false, {0x1p32f, 0x1p24f, 3}},
  };
  for (const Case& one : cases) {
    GlbBuilder builder;
    const int accessor = builder.Accessor(builder.View(one.bytes, one.stride), one.type, "SCALAR", 3, one.normalized);
    const auto read = Attributes(LoadWith(builder, {{"_ID", accessor}}));
    ASSERT_THAT(read, SizeIs(1));
    EXPECT_EQ(read[0].values, one.want) << one.type << " " << one.normalized;
  }
}

TEST(GltfOwnAttributes, SparseValuesReplaceElements) {
  GlbBuilder builder;
  const int accessor = builder.Accessor(-1, testing::kF32, "VEC2", 3);
  builder.doc["accessors"][accessor]["sparse"] = {
      {"count", 1},
      {"indices", {{"bufferView", builder.View({1})}, {"componentType", testing::kU8}}},
      {"values", {{"bufferView", builder.View(AsBytes(std::vector<float>{7, 8}))}}}};
  const auto read = Attributes(LoadWith(builder, {{"_FLOW", accessor}}));
  ASSERT_THAT(read, SizeIs(1));
  EXPECT_THAT(read[0].values, ElementsAre(0, 0, 7, 8, 0, 0));
}

TEST(GltfOwnAttributes, SeveralComeByName) {
  GlbBuilder builder;
  const auto read = Attributes(
      LoadWith(builder, {{"_B", builder.Vectors({1, 2, 3}, "SCALAR")}, {"_A", builder.Vectors({4, 5, 6}, "SCALAR")}}));
  ASSERT_THAT(read, SizeIs(2));
  EXPECT_EQ(read[0].name, "_A");
  EXPECT_EQ(read[1].name, "_B");
}

TEST(GltfOwnAttributes, FaultsAreThoseOfAnyAttribute) {
  const auto error = [](const auto& make) {
    GlbBuilder builder;
    const json attributes = make(builder);
    const absl::Status status = LoadWith(builder, attributes).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
    return std::string(status.message());
  };
  EXPECT_THAT(error([](GlbBuilder& b) {
                return json{{"_T", b.Vectors({1, 2}, "SCALAR")}};
              }),
              HasSubstr("mesh 0, primitive 0: _T (accessor 0) has 2 elements, POSITION has 3"));
  EXPECT_THAT(error([](GlbBuilder&) { return json{{"_T", 99}}; }), HasSubstr("_T 99 is out of range"));
  EXPECT_THAT(error([](GlbBuilder& b) {
                return json{{"_T", b.Accessor(b.View({1, 2, 3, 4}), testing::kF32, "SCALAR", 3)}};
              }),
              HasSubstr("accessor 0: 3 elements of 4 bytes"));
}

TEST(GltfOwnAttributes, WhatIsNotFiniteCountsAsZeroWithAWarning) {
  GlbBuilder builder;
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const auto scene = LoadWith(builder, {{"_T", builder.Vectors({1, nan, 3}, "SCALAR")}});
  EXPECT_THAT(Attributes(scene).at(0).values, ElementsAre(1, 0, 3));
  EXPECT_THAT(testing::Lines(scene->warnings),
              ElementsAre(HasSubstr("_T (accessor 0) has values that are not finite")));
}

TEST(GltfOwnAttributes, MatricesAndUnprintableNamesAreIgnoredWithAWarning) {
  GlbBuilder builder;
  const int matrices = builder.Vectors(std::vector<float>(12, 1), "MAT2");
  const int good = builder.Vectors({1, 2, 3}, "SCALAR");
  const auto scene = LoadWith(builder, {{"_M", matrices}, {"_new\nline", good}, {"_" + std::string(128, 'x'), good}});
  EXPECT_THAT(Attributes(scene), IsEmpty());
  EXPECT_THAT(
      testing::Lines(scene->warnings),
      ::testing::UnorderedElementsAre(HasSubstr("_M (accessor 0)"), HasSubstr("printable"), HasSubstr("printable")));
}

TEST(GltfOwnAttributes, PrimitivesThatDifferAreNamedInWarnings) {
  GlbBuilder builder;
  json with = builder.Primitive(kTriangle), wide = with;
  const json without = with;
  with["attributes"]["_T"] = builder.Vectors({1, 2, 3}, "SCALAR");
  wide["attributes"]["_T"] = builder.Vectors(std::vector<float>(9, 1), "VEC3");
  json points = with;
  points["mode"] = 0;  // draws no triangle, so it misses nothing
  const int mesh = builder.Mesh(with);
  for (const json& other : {wide, without, points}) builder.doc["meshes"][mesh]["primitives"].push_back(other);
  builder.Scene({builder.Node({{"mesh", mesh}})});
  const auto scene = LoadScene(builder.Glb());
  ASSERT_TRUE(scene.ok()) << scene.status();
  EXPECT_THAT(testing::Lines(scene->warnings),
              ElementsAre(HasSubstr("mesh 0: 1 of 4 primitives are points or lines"),
                          HasSubstr("attribute _T: is missing in 1 of 3 primitives; it counts as 0 there"),
                          HasSubstr("attribute _T: has 1 to 3 components")));
}

// Instances carry attributes too (EXT_mesh_gpu_instancing), which are no vertex attributes.
TEST(GltfOwnAttributes, ThoseOfInstancesAreNotKept) {
  GlbBuilder builder;
  json node = {{"mesh", builder.Mesh(builder.Primitive(kTriangle))}};
  node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {
      {"TRANSLATION", builder.Vectors({1, 0, 0, 0, 5, 0}, "VEC3")}, {"_ID", builder.Vectors({1, 2}, "SCALAR")}};
  builder.Scene({builder.Node(node)});
  const auto scene = LoadScene(builder.Glb());
  EXPECT_THAT(Attributes(scene), IsEmpty());
  EXPECT_THAT(scene->nodes[0].instances, SizeIs(2));
  EXPECT_THAT(testing::Lines(scene->warnings), IsEmpty());
}

}  // namespace
}  // namespace voxelpipe
