// What valid glTF files say, and what the loader makes of it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <numbers>
#include <utility>

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
using Triangle = std::array<uint32_t, 3>;

const std::vector<Vec3f> kSquare = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
const std::vector<uint32_t> kSquareIndices = {0, 1, 2, 0, 2, 3};

Scene Load(const GlbBuilder& builder) {
  absl::StatusOr<Scene> scene = LoadScene(builder.Glb());
  EXPECT_TRUE(scene.ok()) << scene.status();
  return scene.ok() ? *std::move(scene) : Scene{};
}

// Makes the default scene one node with a mesh of this one primitive.
void Draw(GlbBuilder& builder, const json& primitive) {
  builder.Scene({builder.Node({{"mesh", builder.Mesh(primitive)}})});
}

Primitive LoadPrimitive(GlbBuilder& builder, const json& primitive) {
  Draw(builder, primitive);
  const Scene scene = Load(builder);
  if (scene.meshes.size() != 1 || scene.meshes[0].primitives.size() != 1) {
    ADD_FAILURE() << "not one primitive";
    return {};
  }
  return scene.meshes[0].primitives[0];
}

TEST(Sniff, KnowsGltfAndDraco) {
  const auto sniff = [](std::string_view text) {
    return SniffMeshFormat({reinterpret_cast<const uint8_t*>(text.data()), text.size()});
  };
  EXPECT_EQ(sniff("glTF...."), MeshFormat::kGlb);
  EXPECT_EQ(sniff("DRACO..."), MeshFormat::kDraco);
  EXPECT_EQ(sniff(" \n{\"asset\""), MeshFormat::kGltf);
  EXPECT_EQ(sniff("\x1f\x8b"), std::nullopt);
  EXPECT_EQ(sniff("solid stl"), MeshFormat::kStl);
  EXPECT_EQ(sniff(""), std::nullopt);
}

TEST(Gltf, GlbAndTextGiveTheSameScene) {
  GlbBuilder builder;
  Draw(builder, builder.Primitive(kSquare, kSquareIndices));
  const absl::StatusOr<Scene> glb = LoadScene(builder.Glb()), text = LoadScene(builder.Gltf());
  ASSERT_TRUE(glb.ok()) << glb.status();
  ASSERT_TRUE(text.ok()) << text.status();
  EXPECT_EQ(glb->format, "glb");
  EXPECT_EQ(text->format, "gltf");
  for (const Scene* scene : {&*glb, &*text}) {
    EXPECT_EQ(scene->meshes[0].primitives[0].positions, kSquare);
    EXPECT_THAT(scene->meshes[0].primitives[0].triangles, ElementsAre(Triangle{0, 1, 2}, Triangle{0, 2, 3}));
    EXPECT_THAT(scene->roots, ElementsAre(0));
    EXPECT_THAT(testing::Lines(scene->warnings), IsEmpty());
  }
}

TEST(Gltf, AStrideThatTheFormatForbidsIsReadWithAWarning) {
  for (const auto& [stride, warned] : {std::pair{12, false}, {13, true}, {252, false}, {254, true}, {256, true}}) {
    GlbBuilder builder;
    ByteVector bytes(size_t(stride) * kSquare.size());
    for (size_t i = 0; i < kSquare.size(); ++i) std::memcpy(&bytes[i * size_t(stride)], &kSquare[i], sizeof(Vec3f));
    const int positions = builder.Accessor(builder.View(bytes, stride), testing::kF32, "VEC3", kSquare.size());
    Draw(builder, {{"attributes", {{"POSITION", positions}}}, {"indices", builder.Indices(kSquareIndices)}});
    const Scene scene = Load(builder);
    EXPECT_EQ(scene.meshes[0].primitives[0].positions, kSquare) << stride;
    const std::string text =
        "bufferView 0: byteStride " + std::to_string(stride) + " is no multiple of 4 from 4 to 252";
    EXPECT_EQ(testing::Lines(scene.warnings), warned ? std::vector<std::string>{text} : std::vector<std::string>{});
  }
}

TEST(Gltf, EveryIndexType) {
  for (const int type : {testing::kU8, testing::kU16, testing::kU32}) {
    GlbBuilder builder;
    const json primitive = {{"attributes", {{"POSITION", builder.Positions(kSquare)}}},
                            {"indices", builder.Indices(kSquareIndices, type)}};
    EXPECT_THAT(LoadPrimitive(builder, primitive).triangles, ElementsAre(Triangle{0, 1, 2}, Triangle{0, 2, 3})) << type;
  }
}

TEST(Gltf, WithoutIndicesVerticesComeInOrder) {
  GlbBuilder builder;
  const json primitive = builder.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {0, 1, 1}});
  EXPECT_THAT(LoadPrimitive(builder, primitive).triangles, ElementsAre(Triangle{0, 1, 2}, Triangle{3, 4, 5}));
}

TEST(Gltf, StripsAlternateTheirWinding) {
  GlbBuilder builder;
  json primitive = builder.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}, {0, 2, 0}}, {0, 1, 2, 3, 4});
  primitive["mode"] = 5;
  EXPECT_THAT(LoadPrimitive(builder, primitive).triangles,
              ElementsAre(Triangle{0, 1, 2}, Triangle{1, 3, 2}, Triangle{2, 3, 4}));
}

TEST(Gltf, FansShareTheirFirstVertex) {
  GlbBuilder builder;
  json primitive = builder.Primitive(kSquare, {0, 1, 2, 3});
  primitive["mode"] = 6;
  EXPECT_THAT(LoadPrimitive(builder, primitive).triangles, ElementsAre(Triangle{1, 2, 0}, Triangle{2, 3, 0}));
}

TEST(Gltf, PointsAndLinesDrawNoTriangles) {
  for (int mode = 0; mode < 4; ++mode) {
    GlbBuilder builder;
    json primitive = builder.Primitive(kSquare, kSquareIndices);
    primitive["mode"] = mode;
    EXPECT_THAT(LoadPrimitive(builder, primitive).triangles, IsEmpty()) << mode;
  }
}

TEST(Gltf, LeftOverIndicesAreDroppedWithAWarning) {
  GlbBuilder builder;
  Draw(builder, builder.Primitive(kSquare, {0, 1, 2, 3, 0}));
  const Scene loaded = Load(builder);
  EXPECT_THAT(loaded.meshes[0].primitives[0].triangles, ElementsAre(Triangle{0, 1, 2}));
  EXPECT_THAT(testing::Lines(loaded.warnings), ElementsAre(HasSubstr("mesh 0, primitive 0")));
}

TEST(Gltf, QuantizedPositionsOfEveryType) {
  struct Case {
    int type;
    ByteVector bytes;
    bool normalized;
    Vec3f want;
  };
  const std::vector<Case> cases = {
      {testing::kI8, AsBytes(std::vector<int8_t>{-128, 127, 0}), true, {-1, 1, 0}},
      {testing::kI8, AsBytes(std::vector<int8_t>{-128, 127, 0}), false, {-128, 127, 0}},
      {testing::kU8, AsBytes(std::vector<uint8_t>{255, 0, 51}), true, {1, 0, 0.2f}},
      {testing::kI16, AsBytes(std::vector<int16_t>{-32768, 32767, -32767}), true, {-1, 1, -1}},
      {testing::kU16, AsBytes(std::vector<uint16_t>{65535, 0, 13107}), true, {1, 0, 0.2f}},
      {testing::kU16, AsBytes(std::vector<uint16_t>{65535, 0, 13107}), false, {65535, 0, 13107}},
  };
  for (const Case& one : cases) {
    GlbBuilder builder;
    const int accessor = builder.Accessor(builder.View(one.bytes), one.type, "VEC3", 1, one.normalized);
    const Primitive primitive = LoadPrimitive(builder, {{"attributes", {{"POSITION", accessor}}}});
    EXPECT_THAT(primitive.positions, ElementsAre(one.want)) << one.type << " " << one.normalized;
  }
}

TEST(Gltf, InterleavedAttributesAndOffsets) {
  GlbBuilder builder;
  std::vector<float> data;
  for (const Vec3f& p : kSquare) data.insert(data.end(), {p.x, p.y, p.z, 0, 0, 1, 0.5f, p.y});
  const int view = builder.View(AsBytes(data), 32);
  const int positions = builder.Accessor(view, testing::kF32, "VEC3", 4);
  const int normals = builder.Accessor(view, testing::kF32, "VEC3", 4);
  const int uv = builder.Accessor(view, testing::kF32, "VEC2", 4);
  builder.doc["accessors"][normals]["byteOffset"] = 12;
  builder.doc["accessors"][uv]["byteOffset"] = 24;
  const Primitive primitive =
      LoadPrimitive(builder, {{"attributes", {{"POSITION", positions}, {"NORMAL", normals}, {"TEXCOORD_1", uv}}},
                              {"indices", builder.Indices(kSquareIndices)}});
  EXPECT_EQ(primitive.positions, kSquare);
  EXPECT_THAT(primitive.normals, ::testing::Each(Vec3f{0, 0, 1}));
  EXPECT_THAT(primitive.uv[0], IsEmpty());
  EXPECT_THAT(primitive.uv[1], ElementsAre(Vec2f{0.5f, 0}, Vec2f{0.5f, 0}, Vec2f{0.5f, 1}, Vec2f{0.5f, 1}));
}

TEST(Gltf, SparseAccessorsReplaceElements) {
  for (const bool with_base : {true, false}) {
    GlbBuilder builder;
    const int positions = with_base ? builder.Positions(kSquare) : builder.Accessor(-1, testing::kF32, "VEC3", 4);
    builder.doc["accessors"][positions]["sparse"] = {
        {"count", 2},
        {"indices", {{"bufferView", builder.View({1, 3})}, {"componentType", testing::kU8}}},
        {"values", {{"bufferView", builder.View(AsBytes(std::vector<float>{7, 8, 9, -1, -2, -3}))}}}};
    const Primitive primitive = LoadPrimitive(builder, {{"attributes", {{"POSITION", positions}}}});
    const Vec3f base = with_base ? kSquare[2] : Vec3f{0, 0, 0};
    EXPECT_THAT(primitive.positions, ElementsAre(Vec3f{0, 0, 0}, Vec3f{7, 8, 9}, base, Vec3f{-1, -2, -3}));
  }
}

TEST(Gltf, ColoursGetAlphaOne) {
  GlbBuilder builder;
  json primitive = builder.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  primitive["attributes"]["COLOR_0"] =
      builder.Accessor(builder.View({255, 0, 51, 0, 0, 255, 0, 0, 51, 51, 51, 0}, 4), testing::kU8, "VEC3", 3, true);
  EXPECT_THAT(LoadPrimitive(builder, primitive).colors,
              ElementsAre(Vec4f{1, 0, 0.2f, 1}, Vec4f{0, 1, 0, 1}, Vec4f{0.2f, 0.2f, 0.2f, 1}));
}

TEST(Gltf, MatrixAndTrsAgree) {
  GlbBuilder builder;
  const double half = std::numbers::sqrt2 / 2;
  // A quarter turn about z, not normalized on purpose; glTF's matrices are column-major.
  builder.Node({{"translation", {1, 2, 3}}, {"rotation", {0, 0, 3 * half, 3 * half}}, {"scale", {2, 3, -4}}});
  builder.Node({{"matrix", {0, 2, 0, 0, -3, 0, 0, 0, 0, 0, -4, 0, 1, 2, 3, 1}}});
  builder.Scene({0, 1});
  const Scene scene = Load(builder);
  ASSERT_THAT(scene.nodes, SizeIs(2));
  for (int i = 0; i < 4; ++i) {
    for (int j = 0; j < 4; ++j) EXPECT_NEAR(scene.nodes[0].local.m[i][j], scene.nodes[1].local.m[i][j], 1e-12);
  }
  EXPECT_EQ(scene.nodes[1].local.m[0][3], 1);
  EXPECT_EQ(scene.nodes[1].local.m[1][0], 2);
}

TEST(Gltf, TheDefaultSceneElseTheFirstElseAllRoots) {
  GlbBuilder builder;
  for (int i = 0; i < 3; ++i) builder.Node(json::object());
  builder.Scene({0});
  builder.doc["scenes"].push_back({{"nodes", {1, 2}}});
  builder.doc["scene"] = 1;
  EXPECT_THAT(Load(builder).roots, ElementsAre(1, 2));
  builder.doc.erase("scene");
  EXPECT_THAT(Load(builder).roots, ElementsAre(0));
  builder.doc.erase("scenes");
  const Scene none = Load(builder);
  EXPECT_THAT(none.roots, ElementsAre(0, 1, 2));
  EXPECT_THAT(testing::Codes(none.warnings), ElementsAre("no_scene"));
}

TEST(Gltf, GpuInstancingBecomesInstances) {
  GlbBuilder builder;
  const int mesh = builder.Mesh(builder.Primitive(kSquare, kSquareIndices));
  const int translations = builder.Vectors({1, 0, 0, 0, 5, 0}, "VEC3");
  const int scales = builder.Vectors({1, 1, 1, 2, 2, 2}, "VEC3");
  json node = {{"mesh", mesh}};
  node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {{"TRANSLATION", translations}, {"SCALE", scales}};
  builder.Scene({builder.Node(node)});
  builder.doc["extensionsRequired"] = {"EXT_mesh_gpu_instancing"};
  const Scene scene = Load(builder);
  ASSERT_THAT(scene.nodes[0].instances, SizeIs(2));
  EXPECT_EQ(scene.nodes[0].instances[0].m[0][3], 1);
  EXPECT_EQ(scene.nodes[0].instances[1].m[1][3], 5);
  EXPECT_EQ(scene.nodes[0].instances[1].m[2][2], 2);
}

TEST(Gltf, HiddenNodesLoseTheirMeshAndSoDoTheirChildren) {
  GlbBuilder builder;
  const int mesh = builder.Mesh(builder.Primitive(kSquare, kSquareIndices));
  const int child = builder.Node({{"mesh", mesh}});
  json parent = {{"mesh", mesh}, {"children", {child}}};
  parent["extensions"]["KHR_node_visibility"]["visible"] = false;
  const int hidden = builder.Node(parent), shown = builder.Node({{"mesh", mesh}});
  builder.Scene({hidden, shown});
  const Scene scene = Load(builder);
  EXPECT_EQ(scene.nodes[child].mesh, -1);
  EXPECT_EQ(scene.nodes[hidden].mesh, -1);
  EXPECT_EQ(scene.nodes[shown].mesh, mesh);
}

TEST(Gltf, SkinsAndJoints) {
  GlbBuilder builder;
  json primitive = builder.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  primitive["attributes"]["JOINTS_0"] =
      builder.Accessor(builder.View({0, 1, 9, 0, 1, 0, 0, 0, 1, 0, 0, 0}), testing::kU8, "VEC4", 3);
  primitive["attributes"]["WEIGHTS_0"] = builder.Vectors({0.5f, 0.5f, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0}, "VEC4");
  const int mesh = builder.Mesh(primitive);
  std::vector<float> matrices(32, 0.0f);
  for (int i = 0; i < 2; ++i) {
    for (int k = 0; k < 4; ++k) matrices[16 * i + 5 * k] = 1;
    matrices[16 * i + 12] = static_cast<float>(i + 3);  // translation x of a column-major matrix
  }
  builder.Node(json::object());
  builder.Node(json::object());
  builder.doc["skins"] = {{{"joints", {0, 1}}, {"inverseBindMatrices", builder.Vectors(matrices, "MAT4")}},
                          {{"joints", {1, 0}}}};
  builder.Scene({0, 1, builder.Node({{"mesh", mesh}, {"skin", 0}})});
  const Scene scene = Load(builder);
  ASSERT_THAT(scene.skins, SizeIs(2));
  EXPECT_THAT(scene.skins[0].joints, ElementsAre(0, 1));
  EXPECT_EQ(scene.skins[0].inverse_bind_matrices[1].m[0][3], 4);
  EXPECT_EQ(scene.skins[1].inverse_bind_matrices[0], Mat4d{});
  EXPECT_EQ(scene.nodes[2].skin, 0);
  const Primitive& read = scene.meshes[0].primitives[0];
  // Joint 9 does not exist, but has no weight.
  EXPECT_EQ(read.joints[0][0], (std::array<uint16_t, 4>{0, 1, 0, 0}));
  EXPECT_EQ(read.weights[0][0], (std::array<float, 4>{0.5f, 0.5f, 0, 0}));
}

TEST(Gltf, MorphTargetsAtDefaultWeightsAndANodesOwn) {
  GlbBuilder builder;
  json primitive = builder.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  primitive["targets"] = {{{"POSITION", builder.Positions({{0, 0, 1}, {0, 0, 1}, {0, 0, 1}})}},
                          {{"POSITION", builder.Positions({{8, 0, 0}, {8, 0, 0}, {8, 0, 0}})}}};
  const int mesh = builder.Mesh(primitive);
  builder.doc["meshes"][mesh]["weights"] = {0.5, 0};
  builder.Scene({builder.Node({{"mesh", mesh}}), builder.Node({{"mesh", mesh}, {"weights", {0, 0.25}}}),
                 builder.Node({{"mesh", mesh}, {"weights", {0, 0.25}}})});
  const Scene scene = Load(builder);
  ASSERT_THAT(scene.meshes, SizeIs(2));
  EXPECT_EQ(scene.nodes[0].mesh, 0);
  EXPECT_EQ(scene.nodes[1].mesh, 1);
  EXPECT_EQ(scene.nodes[2].mesh, 1);
  EXPECT_EQ(scene.meshes[0].primitives[0].positions[1], (Vec3f{1, 0, 0.5f}));
  EXPECT_EQ(scene.meshes[1].primitives[0].positions[1], (Vec3f{3, 0, 0}));
}

}  // namespace
}  // namespace voxelpipe
