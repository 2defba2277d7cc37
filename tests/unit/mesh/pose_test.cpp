// Poses of generated GLB files, against positions worked out by hand.
#include "mesh/scene/pose.h"

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "load/loader.h"
#include "mesh/flatten.h"
#include "support/meshes/glb_builder.h"

namespace voxelpipe {
namespace {

using testing::GlbBuilder;
using ::testing::HasSubstr;

// A triangle with one morph target (+z), under a node that moves from x = 0 at 1 s to x = 10 at 3 s.
struct Moving {
  GlbBuilder glb;
  int times = 0;
  explicit Moving(const std::vector<float>& keys = {1, 3}) {
    nlohmann::json primitive = glb.Primitive({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}});
    primitive["targets"] = {{{"POSITION", glb.Positions({{0, 0, 4}, {0, 0, 4}, {0, 0, 4}})}}};
    const int mesh = glb.Mesh(primitive);
    const int node = glb.Node({{"mesh", mesh}});
    glb.Scene({node});
    times = glb.Vectors(keys, "SCALAR");
    const int move = glb.Vectors({0, 0, 0, 10, 0, 0}, "VEC3"), weights = glb.Vectors({0, 1}, "SCALAR");
    nlohmann::json animation;
    animation["samplers"] = {{{"input", times}, {"output", move}}, {{"input", times}, {"output", weights}}};
    animation["channels"] = {{{"sampler", 0}, {"target", {{"node", node}, {"path", "translation"}}}},
                             {{"sampler", 1}, {"target", {{"node", node}, {"path", "weights"}}}}};
    glb.doc["animations"] = nlohmann::json::array({animation});
  }
  TriangleMesh Flat() const {
    const auto scene = LoadScene(glb.Glb());
    EXPECT_TRUE(scene.ok()) << scene.status();
    if (!scene.ok()) return {};
    auto mesh = Flatten(*scene);
    EXPECT_TRUE(mesh.ok()) << mesh.status();
    return mesh.ok() ? *std::move(mesh) : TriangleMesh{};
  }
};

Vec3d FirstVertex(const Rig& rig, const PoseQuery& query) {
  const auto pose = EvaluatePose(rig, query);
  EXPECT_TRUE(pose.ok()) << pose.status();
  if (!pose.ok()) return {};
  std::vector<MorphTargetView> targets;
  const RestPrimitiveView rest = RestView(*rig.parts[0].primitive, targets);
  return PoseVertex(rest, (*pose)->parts[0], 0).position;
}

TEST(PoseTest, NodesAndWeightsFollowTheAnimation) {
  const TriangleMesh mesh = Moving().Flat();
  ASSERT_NE(mesh.rig, nullptr);
  PoseQuery query;
  query.animation = 0;
  query.time = 1.5;  // a quarter of the way
  EXPECT_EQ(FirstVertex(*mesh.rig, query), (Vec3d{2.5, 0, 1}));
  query.time = 99;
  EXPECT_EQ(FirstVertex(*mesh.rig, query), (Vec3d{10, 0, 4}));
  query.nodes = false;
  EXPECT_EQ(FirstVertex(*mesh.rig, query), (Vec3d{0, 0, 4}));
}

TEST(PoseTest, GivenWeightsReplaceTheFiles) {
  const TriangleMesh mesh = Moving().Flat();
  PoseQuery query;
  query.weights = {0.5};
  EXPECT_EQ(FirstVertex(*mesh.rig, query), (Vec3d{0, 0, 2}));
  query.weights = {0.5, 1};
  EXPECT_THAT(std::string(EvaluatePose(*mesh.rig, query).status().message()), HasSubstr("2 given, the mesh has 1"));
}

TEST(PoseTest, ABrokenAnimationFailsOnlyWhenAskedFor) {
  const TriangleMesh mesh = Moving({3, 1}).Flat();  // loads
  PoseQuery query;
  EXPECT_EQ(FirstVertex(*mesh.rig, query), (Vec3d{0, 0, 0}));
  query.animation = 0;
  const absl::Status bad = EvaluatePose(*mesh.rig, query).status();
  EXPECT_EQ(bad.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(bad.message()), HasSubstr("animation 0, sampler 0: input (accessor"));
  query.animation = 1;
  EXPECT_THAT(std::string(EvaluatePose(*mesh.rig, query).status().message()), HasSubstr("the file has 1 animation"));
}

}  // namespace
}  // namespace voxelpipe
