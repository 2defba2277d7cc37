// Several meshes on one grid: each placed by its matrix, with running numbers.
#include <cmath>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "load/loader.h"
#include "mesh/flatten.h"
#include "mesh/placed_mesh.h"
#include "mesh/scene/vertex_pose.h"
#include "support/meshes/glb_builder.h"
#include "support/meshes/meshes.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using testing::AttributedSoup;
using testing::Cube;
using testing::FloatAt;
using testing::GlbBuilder;
using ::testing::HasSubstr;
using testing::Rotation;
using testing::RunPipeline;

std::shared_ptr<const TriangleMesh> Shared(TriangleMesh mesh) {
  return std::make_shared<const TriangleMesh>(std::move(mesh));
}

Mat4d Moved(Mat4d m, double x, double y, double z) {
  m.m[0][3] = x;
  m.m[1][3] = y;
  m.m[2][3] = z;
  return m;
}

PlacedMesh Entry(std::shared_ptr<const TriangleMesh> mesh, const Mat4d& matrix = {}, const std::string& name = "") {
  PlacedMesh placed;
  placed.mesh = std::move(mesh);
  placed.matrix = matrix;
  placed.name = name;
  return placed;
}

TriangleMesh Place(const std::vector<PlacedMesh>& meshes) {
  const JobContext job;
  absl::StatusOr<TriangleMesh> mesh = PlaceMeshes(job, meshes);
  EXPECT_TRUE(mesh.ok()) << mesh.status();
  return mesh.ok() ? *std::move(mesh) : TriangleMesh{};
}

absl::Status Error(const std::vector<PlacedMesh>& meshes) {
  const JobContext job;
  return PlaceMeshes(job, meshes).status();
}

TriangleMesh Flat(const std::vector<uint8_t>& glb) {
  const auto scene = LoadScene(glb);
  EXPECT_TRUE(scene.ok()) << scene.status();
  if (!scene.ok()) return {};
  auto mesh = Flatten(*scene);
  EXPECT_TRUE(mesh.ok()) << mesh.status();
  return mesh.ok() ? *std::move(mesh) : TriangleMesh{};
}

VoxelizeRequest AllKinds() {
  VoxelizeRequest request;
  request.grid.resolution = 40;
  request.targets.clear();
  for (const char* shader : {"normal", "tangent", "uv", "color", "material_id", "mesh_id", "triangle_id", "position"}) {
    TargetSpec target;
    target.format = VoxelFormat::kF32;
    target.components = std::string(shader).ends_with("_id") ? 1 : 3;
    target.blend = Blend::kReplace;
    target.shader.name = shader;
    request.targets.push_back(target);
  }
  return request;
}

void ExpectSameBytes(const VoxelizeResult& a, const VoxelizeResult& b) {
  EXPECT_EQ(a.grid, b.grid);
  EXPECT_EQ(a.stats.occupied, b.stats.occupied);
  ASSERT_EQ(a.targets.size(), b.targets.size());
  for (size_t t = 0; t < a.targets.size(); ++t) {
    const auto &x = a.targets[t], &y = b.targets[t];
    ASSERT_EQ(x.size(), y.size());
    EXPECT_TRUE(std::equal(x.data(), x.data() + x.size(), y.data())) << "target " << t;
  }
}

TEST(PlaceMeshesTest, TheIdentityGivesTheBytesOfTheMeshAlone) {
  const auto soup = Shared(AttributedSoup(200, 3, 7));
  ExpectSameBytes(RunPipeline(Place({Entry(soup)}), AllKinds()), RunPipeline(*soup, AllKinds()));
}

TEST(PlaceMeshesTest, PositionsAndNormalsAreThoseOfTheMatrix) {
  const auto soup = Shared(AttributedSoup(50, 3, 7));
  const Mat4d m = Moved(Rotation({1, 2, 3}, 0.7), 4, -5, 6);
  const TriangleMesh placed = Place({Entry(soup, m)});
  ASSERT_EQ(placed.positions.size(), soup->positions.size());
  for (size_t v = 0; v < placed.positions.size(); ++v) {
    EXPECT_EQ(placed.positions[v], TransformPoint(m, soup->positions[v]));
    const Vec3f& n = soup->normals[v];
    EXPECT_EQ(placed.normals[v], UnitOrZero(TransformNormal(m, {n.x, n.y, n.z})));
  }
  EXPECT_EQ(placed.triangles, soup->triangles);
}

TEST(PlaceMeshesTest, AMirrorSwapsCornersAndHandedness) {
  const auto soup = Shared(AttributedSoup(20, 3, 7));
  Mat4d mirror;
  mirror.m[0][0] = -1;
  const TriangleMesh placed = Place({Entry(soup, mirror)});
  for (size_t t = 0; t < placed.triangles.size(); ++t) {
    const auto &a = soup->triangles[t], &b = placed.triangles[t];
    EXPECT_EQ(b, (std::array<uint32_t, 3>{a[0], a[2], a[1]}));
  }
  for (size_t v = 0; v < placed.tangents.size(); ++v) EXPECT_EQ(placed.tangents[v].w, -soup->tangents[v].w);
}

// Nodes 0 and 1 with meshes 0 and 1; the second alone has a material, textured; mesh 2 is not drawn.
std::vector<uint8_t> TwoMeshes() {
  GlbBuilder glb;
  nlohmann::json plain = glb.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
  nlohmann::json painted = plain;
  painted["material"] = 0;
  glb.doc["materials"] = nlohmann::json::array({{{"name", "red"}}});
  const int first = glb.Mesh(plain), second = glb.Mesh(painted);
  glb.Mesh(plain);
  glb.Scene({glb.Node({{"mesh", first}}), glb.Node({{"mesh", second}})});
  return glb.Glb();
}

TEST(PlaceMeshesTest, NumbersRunOn) {
  const auto mesh = Shared(Flat(TwoMeshes()));
  EXPECT_EQ(mesh->mesh_count, 3u);
  EXPECT_EQ(mesh->node_count, 2u);
  const TriangleMesh placed = Place({Entry(mesh, {}, "a"), Entry(mesh, Moved({}, 5, 0, 0), "b")});
  ASSERT_EQ(placed.parts.size(), 4u);
  EXPECT_EQ(placed.parts[3].mesh, 4u);
  EXPECT_EQ(placed.parts[3].node, 3u);
  EXPECT_EQ(placed.parts[3].material, 1);
  EXPECT_EQ(placed.parts[3].first_triangle, 3u);
  EXPECT_EQ(placed.parts[3].first_vertex, 9u);
  EXPECT_EQ(placed.parts[2].material, -1) << "the default material comes last";
  EXPECT_EQ(placed.materials.size(), 2u);
  EXPECT_EQ(placed.mesh_count, 6u);
  EXPECT_EQ(placed.node_count, 4u);
  ASSERT_EQ(placed.placed.size(), 2u);
  EXPECT_EQ(placed.placed[1].first_part, 2u);
  EXPECT_EQ(placed.placed[1].name, "b");
  EXPECT_EQ(placed.placed[1].label, 2u) << "its number in the list";
  EXPECT_EQ(placed.triangles[3], (std::array<uint32_t, 3>{9, 10, 11}));
}

TEST(PlaceMeshesTest, TexturesOfAMeshThatIsPlacedOftenAreListedOnce) {
  const auto quad = Shared(Flat(testing::TexturedQuadGlb()));
  const TriangleMesh placed =
      Place({Entry(quad), Entry(quad, Moved({}, 2, 0, 0)), Entry(Shared(Flat(testing::TexturedQuadGlb())))});
  ASSERT_EQ(placed.materials.size(), 3 * quad->materials.size());
  EXPECT_EQ(placed.textures.size(), 2 * quad->textures.size());
  EXPECT_EQ(placed.images.size(), 2 * quad->images.size());
  EXPECT_EQ(placed.materials[0].base_color.texture, placed.materials[1].base_color.texture);
  EXPECT_EQ(placed.materials[2].base_color.texture, int32_t(quad->textures.size()));
}

TEST(PlaceMeshesTest, AttributesAreJoinedByName) {
  TriangleMesh narrow = Cube(1), wide = Cube(1), none = Cube(1);
  narrow.attributes.push_back({"_A", 1, std::vector<float>(8, 2)});
  wide.attributes.push_back({"_A", 4, std::vector<float>(32, 3)});
  const TriangleMesh placed = Place({Entry(Shared(narrow)), Entry(Shared(none)), Entry(Shared(wide))});
  ASSERT_EQ(placed.attributes.size(), 1u);
  const VertexAttribute& a = placed.attributes[0];
  EXPECT_EQ(a.components, 4);
  ASSERT_EQ(a.runs.size(), 2u);
  EXPECT_EQ(a.runs[0].end_vertex, 8u);
  EXPECT_EQ(a.runs[1].first_vertex, 16u);
  EXPECT_EQ(a.runs[1].first_value, 32u);
  ASSERT_EQ(a.values.size(), 64u);
  EXPECT_EQ(std::vector<float>(a.values.begin(), a.values.begin() + 4), (std::vector<float>{2, 0, 0, 1}));
  EXPECT_EQ(a.values[32], 3);
  EXPECT_TRUE(Place({Entry(Shared(narrow)), Entry(Shared(wide))}).attributes[0].runs.empty()) << "all have it";
}

TEST(PlaceMeshesTest, EachBodyHasItsMotion) {
  const auto cube = Shared(Cube(1));
  std::vector<PlacedMesh> meshes = {Entry(cube), Entry(cube, Moved({}, 3, 0, 0)), Entry(cube, Moved({}, 6, 0, 0))};
  meshes[1].motion = RigidMotionNumbers{{1, 2, 3}, {}, {}};
  meshes[2].motion = RigidMotionNumbers{{}, {0, 0, 2}, {6.5, 0.5, 0.5}};
  VoxelizeRequest request;
  request.grid.dims = {7, 1, 1};
  request.grid.voxel_size = Vec3d{1, 1, 1};
  request.grid.origin = Vec3d{0, 0, 0};
  request.targets[0] = {.format = VoxelFormat::kF32, .components = 3, .blend = Blend::kMax, .shader = {"velocity", {}}};
  const VoxelizeResult result = RunPipeline(Place(meshes), request);
  const HostBuffer& v = result.targets[0];
  EXPECT_EQ(FloatAt(v, 0), 0);
  EXPECT_EQ(FloatAt(v, 9), 1);
  EXPECT_EQ(FloatAt(v, 10), 2);
  EXPECT_EQ(FloatAt(v, 11), 3);
  EXPECT_EQ(FloatAt(v, 18), 1) << "2 rad/s at half a unit";
  // Without parts the inside of several bodies has no velocity.
  request.grid = {};
  request.grid.resolution = 70;
  request.fill = Fill::kParity;
  const VoxelizeResult filled = RunPipeline(Place(meshes), request);
  ASSERT_FALSE(filled.stats.warnings.empty());
  EXPECT_EQ(filled.stats.warnings.kept()[0].code, WarningCode::kFillHasNoValue);
}

// A node that moves from x = 0 at 1 s to x = 10 at 3 s.
TriangleMesh Moving() {
  GlbBuilder glb;
  const int mesh = glb.Mesh(glb.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}));
  const int node = glb.Node({{"mesh", mesh}});
  glb.Scene({node});
  nlohmann::json animation;
  animation["samplers"] = {
      {{"input", glb.Vectors({1, 3}, "SCALAR")}, {"output", glb.Vectors({0, 0, 0, 10, 0, 0}, "VEC3")}}};
  animation["channels"] = {{{"sampler", 0}, {"target", {{"node", node}, {"path", "translation"}}}}};
  glb.doc["animations"] = nlohmann::json::array({animation});
  return Flat(glb.Glb());
}

TEST(PlaceMeshesTest, PosesFollowTheMatrix) {
  const auto moving = Shared(Moving());
  const TriangleMesh placed =
      Place({Entry(moving), Entry(moving, Moved(Rotation({0, 0, 1}, std::acos(0.0)), 0, 0, 7))});
  VoxelizeRequest request;
  request.grid.resolution = 16;
  request.vertex_shader = {"skin", {{"animation", {1}}, {"time", {3}}}};  // the second one's
  const VoxelizeResult result = RunPipeline(placed, request);
  EXPECT_NEAR(result.grid.origin.x, -1, 1e-9) << "turned: its x is -y";
  EXPECT_NEAR(double(result.grid.dims[1]) * result.grid.voxel_size.y, 11, 1) << "10 along y, and its edge";
  request.vertex_shader.parameters["animation"] = {2};
  EXPECT_THAT(std::string(testing::RunError(placed, request).message()), HasSubstr("animation 2 does not exist"));
  const TriangleMesh mixed = Place({Entry(moving), Entry(Shared(Cube(1)))});
  request.vertex_shader.parameters["animation"] = {0};
  EXPECT_THAT(std::string(testing::RunError(mixed, request).message()), HasSubstr("one has none"));
}

TEST(PlaceMeshesTest, WhatIsWrongIsNamed) {
  const auto cube = Shared(Cube(1));
  EXPECT_EQ(Error({}).message(), "no mesh to place");
  Mat4d m;
  m.m[1][2] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(Error({Entry(cube), Entry(cube, m, "wing")}).message(),
            "meshes[1] (wing): matrix[6]: must be a finite number");
  m = {};
  m.m[3][0] = 1;
  EXPECT_THAT(std::string(Error({Entry(cube, m)}).message()), HasSubstr("its last row must be 0 0 0 1"));
  for (const Mat4d& flat : {Mat4d{{{1, 0, 0, 0}, {0, 1, 0, 0}, {0, 0, 0, 0}, {0, 0, 0, 1}}},
                            Mat4d{{{0.1, 0.2, 0.3, 0}, {0.1, 0.2, 0.3, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}}}}) {
    EXPECT_THAT(std::string(Error({Entry(cube, flat)}).message()), HasSubstr("singular"));
  }
  for (const double scale : {1e-30, 1e30}) {
    Mat4d small;
    for (int i = 0; i < 3; ++i) small.m[i][i] = scale;
    EXPECT_TRUE(CheckPlacement(small).ok()) << scale;
  }
  PlacedMesh unlabelled = Entry(cube);
  unlabelled.label = 0;
  EXPECT_EQ(Error({unlabelled}).message(), "meshes[0]: label: must be at least 1");
  EXPECT_THAT(std::string(Error(std::vector<PlacedMesh>(65'536, Entry(cube))).message()), HasSubstr("at most 65535"));
}

TEST(PlaceMeshesTest, WhatItTakesIsBounded) {
  const auto torus = Shared(testing::Torus(100));
  const std::vector<PlacedMesh> many(60'000, Entry(torus));
  const JobContext endless;
  const absl::Status too_many = PlaceMeshes(endless, many).status();
  EXPECT_EQ(too_many.code(), absl::StatusCode::kResourceExhausted);
  EXPECT_THAT(std::string(too_many.message()), HasSubstr("the limit is 50000000"));
  MemoryBudget budget(1 << 20);
  JobContext small;
  small.set_memory(&budget);
  EXPECT_EQ(PlaceMeshes(small, std::vector<PlacedMesh>(10, Entry(torus))).status().code(),
            absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(budget.used_bytes(), 0u);
  JobContext cancelled;
  cancelled.Cancel();
  EXPECT_EQ(PlaceMeshes(cancelled, {{Entry(torus)}}).status().code(), absl::StatusCode::kCancelled);
}

}  // namespace
}  // namespace voxelpipe
