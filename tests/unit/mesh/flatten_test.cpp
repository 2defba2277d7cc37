#include "mesh/flatten.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "base/limit_error.h"
#include "gtest/gtest.h"
#include "mesh/flatten_job.h"
#include "mesh/views/mesh_view.h"

namespace voxelpipe {
namespace {

Primitive OneTriangle() {
  Primitive p;
  p.positions = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  p.normals = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}};
  p.triangles = {{0, 1, 2}};
  return p;
}

Mat4d Translation(double x, double y, double z) {
  Mat4d m;
  m.m[0][3] = x;
  m.m[1][3] = y;
  m.m[2][3] = z;
  return m;
}

Mat4d Scale(double x, double y, double z) {
  Mat4d m;
  m.m[0][0] = x;
  m.m[1][1] = y;
  m.m[2][2] = z;
  return m;
}

Scene SceneOf(std::vector<Node> nodes, std::vector<uint32_t> roots) {
  Scene scene;
  scene.meshes = {Mesh{"", {OneTriangle()}}};
  scene.nodes = std::move(nodes);
  scene.roots = std::move(roots);
  return scene;
}

Node NodeAt(const Mat4d& local, int32_t mesh, std::vector<uint32_t> children = {}) {
  Node node;
  node.local = local;
  node.mesh = mesh;
  node.children = std::move(children);
  return node;
}

TEST(FlattenTest, DepthFirstOrderAndComposedTransforms) {
  const Scene scene = SceneOf(
      {NodeAt(Translation(10, 0, 0), 0, {2}), NodeAt(Translation(0, 0, 7), 0), NodeAt(Scale(2, 2, 2), 0)}, {0, 1});
  const auto mesh = Flatten(scene);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  EXPECT_EQ(CountTriangles(scene), 3u);
  ASSERT_EQ(mesh->parts.size(), 3u);
  EXPECT_EQ(mesh->parts[0].node, 0u);
  EXPECT_EQ(mesh->parts[1].node, 2u);  // the child comes before the next root
  EXPECT_EQ(mesh->parts[2].node, 1u);
  EXPECT_EQ(mesh->positions[1], (Vec3d{11, 0, 0}));
  EXPECT_EQ(mesh->positions[4], (Vec3d{12, 0, 0}));
  EXPECT_EQ(mesh->positions[6], (Vec3d{0, 0, 7}));
  EXPECT_EQ(mesh->triangles[2], (std::array<uint32_t, 3>{6, 7, 8}));
}

TEST(FlattenTest, ANodeOutsideTheSceneIsNotDrawn) {
  const auto mesh = Flatten(SceneOf({NodeAt(Mat4d{}, 0), NodeAt(Mat4d{}, 0)}, {1}));
  ASSERT_TRUE(mesh.ok());
  ASSERT_EQ(mesh->parts.size(), 1u);
  EXPECT_EQ(mesh->parts[0].node, 1u);
}

TEST(FlattenTest, NegativeScaleFlipsWindingAndKeepsNormalsOutward) {
  const auto mesh = Flatten(SceneOf({NodeAt(Scale(1, 1, -1), 0)}, {0}));
  ASSERT_TRUE(mesh.ok());
  EXPECT_EQ(mesh->triangles[0], (std::array<uint32_t, 3>{0, 2, 1}));
  EXPECT_EQ(mesh->normals[0], (Vec3f{0, 0, -1}));  // agrees with the flipped winding
  const auto twice = Flatten(SceneOf({NodeAt(Scale(-1, 1, -1), 0)}, {0}));
  EXPECT_EQ(twice->triangles[0], (std::array<uint32_t, 3>{0, 1, 2}));
}

TEST(FlattenTest, NormalsOfANonUniformScaleStayPerpendicular) {
  Scene scene = SceneOf({NodeAt(Scale(1, 1, 4), 0)}, {0});
  const float h = float(std::sqrt(0.5));
  scene.meshes[0].primitives[0].normals = {{h, 0, h}, {h, 0, h}, {h, 0, h}};
  const auto mesh = Flatten(scene);
  ASSERT_TRUE(mesh.ok());
  // (1, 0, 1) under the inverse transpose of diag(1, 1, 4): (1, 0, 1/4).
  EXPECT_NEAR(mesh->normals[0].x, 4 / std::sqrt(17.0), 1e-6);
  EXPECT_NEAR(mesh->normals[0].z, 1 / std::sqrt(17.0), 1e-6);
}

TEST(FlattenTest, Instances) {
  Node node = NodeAt(Translation(0, 5, 0), 0);
  node.instances = {Translation(1, 0, 0), Translation(2, 0, 0), Scale(-1, 1, 1)};
  const auto mesh = Flatten(SceneOf({node}, {0}));
  ASSERT_TRUE(mesh.ok());
  ASSERT_EQ(mesh->triangles.size(), 3u);
  EXPECT_EQ(mesh->positions[0], (Vec3d{1, 5, 0}));
  EXPECT_EQ(mesh->positions[3], (Vec3d{2, 5, 0}));
  EXPECT_EQ(mesh->triangles[2], (std::array<uint32_t, 3>{6, 8, 7}));
}

TEST(FlattenTest, ASkinIgnoresItsNodesTransform) {
  Scene scene = SceneOf({NodeAt(Translation(100, 100, 100), 0), NodeAt(Translation(0, 0, 3), -1)}, {0, 1});
  scene.nodes[0].skin = 0;
  scene.skins = {Skin{{1}, {Translation(0, 0, -1)}}};
  Primitive& p = scene.meshes[0].primitives[0];
  p.joints[0].assign(3, {0, 0, 0, 0});
  p.weights[0].assign(3, {2, 0, 0, 0});  // not normalized in the file
  auto mesh = Flatten(scene);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  EXPECT_EQ(mesh->positions[1], (Vec3d{1, 0, 2}));
  p.joints[0][2] = {9, 0, 0, 0};
  mesh = Flatten(scene);
  EXPECT_EQ(mesh.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(std::string(mesh.status().message()).find("vertex 2"), std::string::npos);
}

TEST(FlattenTest, AttributesThatOnlySomePartsHave) {
  Scene scene = SceneOf({NodeAt(Mat4d{}, 0), NodeAt(Mat4d{}, 1)}, {0, 1});
  scene.meshes.push_back(scene.meshes[0]);
  scene.meshes[1].primitives[0].normals.clear();
  scene.meshes[1].primitives[0].colors.assign(3, Vec4f{0.5f, 0, 0, 1});
  const auto mesh = Flatten(scene);
  ASSERT_TRUE(mesh.ok());
  EXPECT_TRUE(mesh->parts[0].has_normals);
  EXPECT_FALSE(mesh->parts[1].has_normals);
  EXPECT_EQ(mesh->normals[4], (Vec3f{0, 0, 0}));
  EXPECT_EQ(mesh->colors[0], (Vec4f{1, 1, 1, 1}));
  EXPECT_EQ(mesh->colors[3].x, 0.5f);
}

TEST(FlattenTest, LimitsAreCheckedBeforeAllocation) {
  Node node = NodeAt(Mat4d{}, 0);
  node.instances.resize(1000);
  const Scene scene = SceneOf({node}, {0});
  LoadLimits limits;
  limits.max_triangles = 999;
  EXPECT_EQ(Flatten(scene, limits).status().code(), absl::StatusCode::kResourceExhausted);
  limits.max_triangles = 1000;
  limits.max_vertices = 2999;
  EXPECT_EQ(Flatten(scene, limits).status().code(), absl::StatusCode::kResourceExhausted);
  limits.max_vertices = 3000;
  EXPECT_TRUE(Flatten(scene, limits).ok());
  limits.max_instances = 999;
  EXPECT_EQ(Flatten(scene, limits).status().code(), absl::StatusCode::kResourceExhausted);
}

TEST(FlattenTest, EndsWithItsJob) {
  const Scene scene = SceneOf({NodeAt(Mat4d{}, 0)}, {0});
  JobContext job;
  ASSERT_TRUE(FlattenFor(job, scene, LoadLimits()).ok());
  job.Cancel();
  EXPECT_EQ(FlattenFor(job, scene, LoadLimits()).status().code(), absl::StatusCode::kCancelled);
  JobContext late;
  late.set_deadline(JobContext::Clock::now());
  EXPECT_EQ(FlattenFor(late, scene, LoadLimits()).status().code(), absl::StatusCode::kDeadlineExceeded);
}

TEST(FlattenTest, OverflowingTransformsAreNamed) {
  Scene scene = SceneOf({NodeAt(Scale(1e300, 1, 1), 0)}, {0});
  scene.meshes[0].primitives[0].positions[1].x = std::numeric_limits<float>::max();
  const auto mesh = Flatten(scene);
  EXPECT_EQ(mesh.status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(std::string(mesh.status().message()).find("node 0, mesh 0, primitive 0, vertex 1"), std::string::npos);
}

// The values of all vertices, 0 where there are none.
std::vector<float> Dense(const VertexAttribute& attribute, size_t vertices) {
  const AttributeView view{attribute.values.data(), attribute.components, uint32_t(attribute.runs.size()),
                           attribute.runs.data()};
  std::vector<float> out;
  for (size_t v = 0; v < vertices; ++v) {
    const float* const values = ValuesOf(view, v);
    for (int c = 0; c < attribute.components; ++c) out.push_back(values == nullptr ? 0 : values[c]);
  }
  return out;
}

TEST(FlattenTest, OwnAttributesAreZeroWhereMissingAndRepeatWithInstances) {
  Primitive heat = OneTriangle(), bare = OneTriangle(), flow = OneTriangle();
  heat.attributes = {{"_HEAT", 1, {1, 2, 3}}};
  flow.attributes = {{"_FLOW", 2, {1, 2, 3, 4, 5, 6}}, {"_HEAT", 1, {7, 8, 9}}};
  Scene scene = SceneOf({NodeAt(Mat4d{}, 0)}, {0});
  scene.meshes[0].primitives = {bare, heat, flow};
  scene.nodes[0].instances = {Translation(1, 0, 0), Translation(2, 0, 0)};
  const auto mesh = Flatten(scene);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  ASSERT_EQ(mesh->attributes.size(), 2u);
  EXPECT_EQ(mesh->attributes[0].name, "_HEAT");
  EXPECT_EQ(mesh->attributes[1].name, "_FLOW");
  const std::vector<float> heats = {0, 0, 0, 1, 2, 3, 7, 8, 9, 0, 0, 0, 1, 2, 3, 7, 8, 9};
  EXPECT_EQ(Dense(mesh->attributes[0], 18), heats);
  EXPECT_EQ(mesh->attributes[0].values.size(), 12u) << "vertices without it take nothing";
  std::vector<float> flows(36, 0.0f);
  for (const size_t first : {12, 30}) std::copy_n(flow.attributes[0].values.data(), 6, flows.data() + first);
  EXPECT_EQ(Dense(mesh->attributes[1], 18), flows);
}

TEST(FlattenTest, TheWidestOwnAttributeRules) {
  Primitive narrow = OneTriangle(), wide = OneTriangle(), bare = OneTriangle();
  narrow.attributes = {{"_A", 2, {1, 2, 3, 4, 5, 6}}};
  wide.attributes = {{"_A", 4, {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12}}};
  Scene scene = SceneOf({NodeAt(Mat4d{}, 0)}, {0});
  scene.meshes[0].primitives = {narrow, wide, bare};
  const auto mesh = Flatten(scene);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  ASSERT_EQ(mesh->attributes.size(), 1u);
  EXPECT_EQ(mesh->attributes[0].components, 4);
  const std::vector<float> want = {1, 2, 0, 1,  3,  4,  0, 1, 5, 6, 0, 1, 1, 2, 3, 4, 5, 6,
                                   7, 8, 9, 10, 11, 12, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0};
  EXPECT_EQ(Dense(mesh->attributes[0], 9), want);
}

TEST(FlattenTest, OwnAttributesThatAllVerticesHaveLieOneAfterTheOther) {
  Primitive heat = OneTriangle();
  heat.attributes = {{"_HEAT", 1, {1, 2, 3}}};
  Scene scene = SceneOf({NodeAt(Mat4d{}, 0)}, {0});
  scene.meshes[0].primitives = {heat, heat};
  const auto mesh = Flatten(scene);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  EXPECT_TRUE(mesh->attributes[0].runs.empty());
  EXPECT_EQ(mesh->attributes[0].values, (std::vector<float>{1, 2, 3, 1, 2, 3}));
}

TEST(FlattenTest, AnAttributeOfPrimitivesWithoutVerticesHasNoValues) {
  Primitive none, bare = OneTriangle();
  none.attributes = {{"_HEAT", 2, {}}};
  none.triangles.clear();
  Scene scene = SceneOf({NodeAt(Mat4d{}, 0)}, {0});
  scene.meshes[0].primitives = {bare, none};
  const auto mesh = Flatten(scene);
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  for (const VertexAttribute& attribute : mesh->attributes) {
    EXPECT_EQ(Dense(attribute, 3), std::vector<float>(6, 0.0f));
  }
}

// Thousands of attributes of a few vertices each must not take vertices x attributes.
TEST(FlattenTest, ManyOwnAttributesTakeMemoryOfTheirValuesAlone) {
  constexpr int kPrimitives = 500;
  Scene scene = SceneOf({NodeAt(Mat4d{}, 0)}, {0});
  scene.meshes[0].primitives.clear();
  for (int i = 0; i < kPrimitives; ++i) {
    Primitive& primitive = scene.meshes[0].primitives.emplace_back(OneTriangle());
    primitive.attributes = {{"_A" + std::to_string(i), 4, std::vector<float>(12, float(i))}};
  }
  MemoryBudget memory(1 << 20);  // all vertices with all attributes: 12 MB
  JobContext job;
  job.set_memory(&memory);
  const auto mesh = FlattenFor(job, scene, {});
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  ASSERT_EQ(mesh->attributes.size(), size_t{kPrimitives});
  for (int i = 0; i < kPrimitives; ++i) {
    const VertexAttribute& attribute = mesh->attributes[size_t(i)];
    EXPECT_EQ(attribute.values, std::vector<float>(12, float(i)));
    const AttributeView view{attribute.values.data(), 4, uint32_t(attribute.runs.size()), attribute.runs.data()};
    EXPECT_EQ(ValuesOf(view, uint64_t(3 * i)), attribute.values.data());
    EXPECT_EQ(ValuesOf(view, uint64_t(3 * i + 2)), attribute.values.data() + 8);
    EXPECT_EQ(ValuesOf(view, uint64_t(3 * i + 3)), nullptr);
    if (i > 0) {
      EXPECT_EQ(ValuesOf(view, uint64_t(3 * i - 1)), nullptr);
    }
  }
}

TEST(FlattenTest, WhatItMakesIsTakenOfTheJobsMemoryAndGivenBackWithTheMesh) {
  Primitive heat = OneTriangle();
  heat.attributes = {{"_HEAT", 1, {1, 2, 3}}};
  Scene scene = SceneOf({NodeAt(Mat4d{}, 0)}, {0});
  scene.meshes[0].primitives = {heat};
  scene.nodes[0].instances.resize(100);
  JobContext job;
  MemoryBudget memory(1 << 20), little(20'000);
  job.set_memory(&memory);
  {
    const auto mesh = FlattenFor(job, scene, {});
    ASSERT_TRUE(mesh.ok()) << mesh.status();
    EXPECT_GE(memory.used_bytes(), 300 * sizeof(Vec3d) + 100 * (sizeof(MeshPart) + 12) + 300 * sizeof(float));
  }
  EXPECT_EQ(memory.used_bytes(), 0u);
  job.set_memory(&little);
  const absl::Status status = FlattenFor(job, scene, {}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted);
  ASSERT_TRUE(LimitErrorOf(status).has_value()) << status;
  EXPECT_EQ(LimitErrorOf(status)->limit_bytes, 20'000u);
  EXPECT_EQ(little.used_bytes(), 0u);
}

// A mesh of primitives that draw nothing costs nothing, however often it stands in the scene.
TEST(FlattenTest, EmptyPrimitivesAreNotPlaced) {
  Scene scene = SceneOf({NodeAt(Mat4d{}, 0)}, {0});
  scene.meshes[0].primitives.assign(50, Primitive{});
  scene.nodes[0].instances.resize(20'000);
  JobContext job;
  MemoryBudget memory(1 << 16);
  job.set_memory(&memory);
  const auto mesh = FlattenFor(job, scene, {});
  ASSERT_TRUE(mesh.ok()) << mesh.status();
  EXPECT_TRUE(mesh->parts.empty());
}

}  // namespace
}  // namespace voxelpipe
