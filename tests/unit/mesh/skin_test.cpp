// The `skin` vertex shader on a generated GLB file: two joints, one below the other, that move, turn and scale
// unevenly, against a slow reference of its own that moves points, not matrices.
#include <cmath>

#include "gtest/gtest.h"
#include "load/loader.h"
#include "mesh/flatten.h"
#include "mesh/scene/pose.h"
#include "support/meshes/glb_builder.h"
#include "support/run.h"

namespace voxelpipe {
namespace {

using nlohmann::json;
using testing::GlbBuilder;

struct Quaternion {
  double x, y, z, w;
};

// Translation, rotation and scale of a node at a time.
struct Frame {
  Vec3d translation;
  Quaternion rotation;
  Vec3d scale;
};

// v turned by q: v + 2 w (u x v) + 2 u x (u x v).
Vec3d Turned(const Quaternion& q, const Vec3d& v) {
  const Vec3d u{q.x, q.y, q.z};
  const Vec3d once = Cross(u, v);
  return v + once * (2 * q.w) + Cross(u, once) * 2.0;
}

Vec3d ScaledBy(const Vec3d& s, const Vec3d& v) {
  return {s.x * v.x, s.y * v.y, s.z * v.z};
}

Vec3d Apply(const Frame& frame, const Vec3d& p) {
  return Turned(frame.rotation, ScaledBy(frame.scale, p)) + frame.translation;
}

double Mix(double a, double b, double u) {
  return a + (b - a) * u;
}
Vec3d Mix(const Vec3d& a, const Vec3d& b, double u) {
  return {Mix(a.x, b.x, u), Mix(a.y, b.y, u), Mix(a.z, b.z, u)};
}

// A turn by `angle` about an axis; between two of them about the same axis, slerp is the turn by the angle between.
Quaternion Turn(const Vec3d& axis, double angle) {
  const double s = std::sin(angle / 2);
  return {axis.x * s, axis.y * s, axis.z * s, std::cos(angle / 2)};
}

// ---- the file ----

const std::vector<float> kTimes = {1, 2, 4};
const Vec3d kMoves[3] = {{0, 0, 0}, {1, 0.5, 0}, {-1, 2, 0.25}};    // of the root, linear
const double kAngles[3] = {0, 1.25, -0.75};                         // of the child about kAxis, radians, by slerp
const Vec3d kScales[3] = {{1, 1, 1}, {2, 0.5, 1.5}, {0.25, 3, 1}};  // of the child, linear
const Vec3d kRootScales[3] = {{1, 1, 1}, {1, 2, 1}, {0.5, 1, 1}};   // of the root, by steps
const Vec3d kAxis{2.0 / 3, 1.0 / 3, 2.0 / 3};
const Vec3d kChildOffset{0, 2, 0};
// Inverse bind matrices: a scale, then a translation.
const Vec3d kBindScale[2] = {{1, 1, 1}, {0.5, 1, 2}}, kBindMove[2] = {{0, 0, 0}, {0.25, -2, 0.5}};

const std::vector<Vec3f> kPositions = {{0, 0, 0}, {1, 0, 0.5f}, {0, 1, 0}, {1, 1, 0.25f}, {0, 2, 0}, {1, 2, -0.5f}};
const std::vector<Vec3f> kNormals = {{0, 0, 1}, {0, 0.6f, 0.8f}, {0.6f, 0, 0.8f}, {0, 0, 1}, {1, 0, 0}, {0, 1, 0}};
// Sums: 1, 0.5, 2, 1 over both sets, 0.75, 1.
const float kWeights0[6][4] = {{1, 0, 0, 0},          {0.25f, 0.25f, 0, 0}, {0.5f, 1.5f, 0, 0},
                               {0.25f, 0.25f, 0.25f}, {0, 0.75f, 0, 0},     {0.5f, 0.5f, 0, 0}};
const uint8_t kJoints0[6][4] = {{0, 1, 0, 0}, {0, 1, 0, 0}, {0, 1, 0, 0}, {0, 1, 1, 0}, {0, 1, 0, 0}, {1, 0, 0, 0}};
const float kWeights1[6][4] = {{}, {}, {}, {0.25f, 0, 0, 0}, {}, {}};
const uint8_t kJoints1[6][4] = {{}, {}, {}, {0, 0, 0, 0}, {}, {}};

void Add(std::vector<float>& to, std::initializer_list<double> values) {
  for (const double v : values) to.push_back(float(v));
}

std::vector<float> Flat(const Vec3d (&list)[3]) {
  std::vector<float> out;
  for (const Vec3d& v : list) Add(out, {v.x, v.y, v.z});
  return out;
}

int JointsOf(GlbBuilder& glb, const uint8_t (&joints)[6][4]) {
  return glb.Accessor(glb.View({&joints[0][0], &joints[0][0] + 24}), testing::kU8, "VEC4", 6);
}
int WeightsOf(GlbBuilder& glb, const float (&weights)[6][4]) {
  return glb.Vectors({&weights[0][0], &weights[0][0] + 24}, "VEC4");
}

testing::ByteVector SkinnedFile() {
  GlbBuilder glb;
  json primitive = glb.Primitive(kPositions, {0, 1, 2, 2, 1, 3, 2, 3, 4, 4, 3, 5});
  std::vector<float> normals;
  for (const Vec3f& n : kNormals) Add(normals, {n.x, n.y, n.z});
  primitive["attributes"]["NORMAL"] = glb.Vectors(normals, "VEC3");
  primitive["attributes"]["JOINTS_0"] = JointsOf(glb, kJoints0);
  primitive["attributes"]["WEIGHTS_0"] = WeightsOf(glb, kWeights0);
  primitive["attributes"]["JOINTS_1"] = JointsOf(glb, kJoints1);
  primitive["attributes"]["WEIGHTS_1"] = WeightsOf(glb, kWeights1);
  const int mesh = glb.Mesh(primitive);
  const int child = glb.Node({{"translation", {kChildOffset.x, kChildOffset.y, kChildOffset.z}}});
  const int root = glb.Node({{"children", {child}}});
  std::vector<float> bind;
  for (int j = 0; j < 2; ++j) {  // columns
    const Vec3d &s = kBindScale[j], &t = kBindMove[j];
    Add(bind, {s.x, 0, 0, 0, 0, s.y, 0, 0, 0, 0, s.z, 0});
    Add(bind, {t.x, t.y, t.z, 1});
  }
  glb.doc["skins"] = {{{"joints", {root, child}}, {"inverseBindMatrices", glb.Vectors(bind, "MAT4")}}};
  // The skinned node's own transform does not count.
  const int body = glb.Node({{"mesh", mesh}, {"skin", 0}, {"translation", {50, 50, 50}}});
  glb.Scene({root, body});
  std::vector<float> turns;
  for (const double angle : kAngles) {
    const Quaternion q = Turn(kAxis, angle);
    Add(turns, {q.x, q.y, q.z, q.w});
  }
  const int times = glb.Vectors(kTimes, "SCALAR");
  json animation;
  const auto add = [&](int node, const char* path, int output, const char* interpolation) {
    animation["channels"].push_back(
        {{"sampler", animation["samplers"].size()}, {"target", {{"node", node}, {"path", path}}}});
    animation["samplers"].push_back({{"input", times}, {"output", output}, {"interpolation", interpolation}});
  };
  add(root, "translation", glb.Vectors(Flat(kMoves), "VEC3"), "LINEAR");
  add(root, "scale", glb.Vectors(Flat(kRootScales), "VEC3"), "STEP");
  add(child, "rotation", glb.Vectors(turns, "VEC4"), "LINEAR");
  add(child, "scale", glb.Vectors(Flat(kScales), "VEC3"), "LINEAR");
  glb.doc["animations"] = json::array({animation});
  return glb.Glb();
}

TriangleMesh SkinnedMesh() {
  const auto scene = LoadScene(SkinnedFile());
  EXPECT_TRUE(scene.ok()) << scene.status();
  auto mesh = Flatten(*scene);
  EXPECT_TRUE(mesh.ok()) << mesh.status();
  return *std::move(mesh);
}

// ---- the reference ----

struct Skeleton {
  Frame root, child;

  explicit Skeleton(double time) {
    const double t = std::min(4.0, std::max(1.0, time));
    const int key = t < 2 ? 0 : 1;
    const double u = key == 0 ? t - 1 : (t - 2) / 2;
    root = {Mix(kMoves[key], kMoves[key + 1], u), {0, 0, 0, 1}, t >= 4 ? kRootScales[2] : kRootScales[key]};
    child = {kChildOffset, Turn(kAxis, Mix(kAngles[key], kAngles[key + 1], u)), Mix(kScales[key], kScales[key + 1], u)};
  }

  Vec3d ByJoint(int joint, const Vec3d& p) const {
    const Vec3d bound = ScaledBy(kBindScale[joint], p) + kBindMove[joint];
    return Apply(root, joint == 0 ? bound : Apply(child, bound));
  }

  // The weighted mean of where the joints take the point; weights count by their share of the sum.
  Vec3d Move(size_t vertex, const Vec3d& p) const {
    Vec3d sum{};
    double total = 0;
    for (int k = 0; k < 4; ++k) {
      sum = sum + ByJoint(kJoints0[vertex][k], p) * double(kWeights0[vertex][k]);
      sum = sum + ByJoint(kJoints1[vertex][k], p) * double(kWeights1[vertex][k]);
      total += double(kWeights0[vertex][k]) + double(kWeights1[vertex][k]);
    }
    return sum * (1 / total);
  }

  Vec3d Position(size_t vertex) const {
    const Vec3f& p = kPositions[vertex];
    return Move(vertex, {p.x, p.y, p.z});
  }

  // The plane across the normal is moved by two of its directions.
  Vec3d Normal(size_t vertex) const {
    const Vec3d n{kNormals[vertex].x, kNormals[vertex].y, kNormals[vertex].z};
    const Vec3d aside = std::abs(n.x) < 0.5 ? Vec3d{1, 0, 0} : Vec3d{0, 1, 0};
    const Vec3d u = Cross(n, aside), v = Cross(n, u);
    const Vec3d zero = Move(vertex, {0, 0, 0});
    const Vec3d moved = Cross(Move(vertex, u) - zero, Move(vertex, v) - zero);
    return moved * (1 / std::sqrt(Dot(moved, moved)));
  }
};

constexpr double kMoments[] = {0, 1, 1.25, 1.9999, 2, 2.5, 3.75, 4, 9};

TEST(SkinTest, PositionsAndNormalsAreTheReferencesAtAnyTime) {
  const TriangleMesh mesh = SkinnedMesh();
  ASSERT_NE(mesh.rig, nullptr);
  std::vector<MorphTargetView> targets;
  const RestPrimitiveView rest = RestView(*mesh.rig->parts[0].primitive, targets);
  for (const double time : kMoments) {
    PoseQuery query;
    query.animation = 0;
    query.time = time;
    const auto pose = EvaluatePose(*mesh.rig, query);
    ASSERT_TRUE(pose.ok()) << pose.status();
    const Skeleton skeleton(time);
    for (size_t v = 0; v < kPositions.size(); ++v) {
      const ShadedVertex got = PoseVertex(rest, (*pose)->parts[0], v);
      const Vec3d position = skeleton.Position(v), normal = skeleton.Normal(v);
      for (int a = 0; a < 3; ++a) {
        EXPECT_NEAR(got.position[a], position[a], 1e-6) << "vertex " << v << " at " << time << " s";
        EXPECT_NEAR(got.normal[a], normal[a], 1e-6) << "normal " << v << " at " << time << " s";
      }
    }
  }
}

TEST(SkinTest, TheRestPoseNormalizesWeightsToo) {
  const TriangleMesh mesh = SkinnedMesh();
  Skeleton rest(0);
  rest.root = {{0, 0, 0}, {0, 0, 0, 1}, {1, 1, 1}};
  rest.child = {kChildOffset, {0, 0, 0, 1}, {1, 1, 1}};
  for (size_t v = 0; v < kPositions.size(); ++v) {
    const Vec3d want = rest.Position(v);
    for (int a = 0; a < 3; ++a) EXPECT_NEAR(mesh.positions[v][a], want[a], 1e-12) << v;
  }
}

// The voxels, and where the velocity comes from: the pose dt seconds later.
TEST(SkinTest, VoxelsAndVelocitiesAreThoseOfTheReferencesMesh) {
  const TriangleMesh mesh = SkinnedMesh();
  for (const double time : {1.25, 2.5}) {
    constexpr double kStep = 0.125;
    VoxelizeRequest request;
    request.grid = testing::UnitGrid(48, 64, 48);
    request.grid.origin = Vec3d{-3.03, -3.03, -3.03};
    request.grid.voxel_size = Vec3d{0.2, 0.2, 0.2};
    request.targets.push_back(testing::FloatTarget(3, Blend::kReplace, {"velocity", {}}));
    request.vertex_shader = {"skin", {{"animation", {0}}, {"time", {time}}, {"dt", {kStep}}}};
    const VoxelizeResult skinned = testing::RunPipeline(mesh, request);

    TriangleMesh moved = mesh;
    moved.rig = nullptr;
    const Skeleton now(time), later(time + kStep);
    double fastest = 0;
    for (size_t v = 0; v < kPositions.size(); ++v) {
      moved.positions[v] = now.Position(v);
      const Vec3d velocity = (later.Position(v) - moved.positions[v]) * (1 / kStep);
      fastest = std::max(fastest, std::sqrt(Dot(velocity, velocity)));
    }
    request.vertex_shader = VoxelizeRequest().vertex_shader;
    const VoxelizeResult plain = testing::RunPipeline(moved, request);
    EXPECT_GT(plain.stats.occupied, 100u);
    EXPECT_EQ(testing::Bytes(skinned.targets[0]), testing::Bytes(plain.targets[0])) << time;
    double seen = 0;
    for (uint64_t n = 0; n < skinned.grid.voxels(); ++n) {
      double square = 0;
      for (uint64_t c = 0; c < 3; ++c) square += std::pow(testing::FloatAt(skinned.targets[1], 3 * n + c), 2);
      seen = std::max(seen, std::sqrt(square));
    }
    EXPECT_LE(seen, fastest * (1 + 1e-5));
    EXPECT_GE(seen, fastest * 0.8) << "a voxel at the fastest vertex has nearly its velocity";
  }
}

}  // namespace
}  // namespace voxelpipe
