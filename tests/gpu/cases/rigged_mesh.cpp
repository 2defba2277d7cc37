#include "gpu/cases/rigged_mesh.h"

#include <cmath>
#include <cstdlib>
#include <random>
#include <utility>

#include "mesh/flatten.h"
#include "mesh/scene/vertex_pose.h"
#include "support/meshes/meshes.h"

namespace voxelpipe::gpu {
namespace {

class Maker {
 public:
  explicit Maker(uint32_t seed) : random_(seed) {}

  Scene Make() {
    Scene scene;
    scene.meshes.push_back({"skinned", {Skinned()}});
    scene.meshes.push_back({"morphed", {Morphed()}, {0.25, 0}});
    scene.meshes.push_back({"plain", {Sphere(6, 4, false)}});
    // 0 root, 1 and 2 joints, 3 skinned, 4 morphed in three places, 5 mirrored
    scene.nodes.resize(6);
    Place(scene.nodes[0], {{0, 0, 0}, {0, 0, 0, 1}, {1, 1, 1}});
    Place(scene.nodes[1], {{12, 10, 12}, {0, 0, 0.2588190451025208, 0.9659258262890683}, {1, 1, 1}});
    Place(scene.nodes[2], {{0, 12, 0}, {0.1305261922200516, 0, 0, 0.9914448613738104}, {1, 0.75, 1}});
    Place(scene.nodes[4], {{26, 20, 20}, {0, 0.3826834323650898, 0, 0.9238795325112867}, {1, 1.25, 1}});
    Place(scene.nodes[5], {{30, 32, 10}, {0, 0, 0, 1}, {-1, 1, 1}});
    scene.nodes[0].children = {1, 3, 4, 5};
    scene.nodes[1].children = {2};
    scene.nodes[3].mesh = 0;
    scene.nodes[3].skin = 0;
    scene.nodes[4].mesh = 1;
    scene.nodes[5].mesh = 2;
    for (const double at : {-6.0, 0.0, 7.5}) {
      Mat4d instance;
      instance.m[0][3] = at;
      instance.m[1][3] = -at / 2;
      scene.nodes[4].instances.push_back(instance);
    }
    Mat4d up, down;
    up.m[1][3] = -12;
    scene.skins.push_back({{1, 2}, {down, up}});
    scene.roots = {0};
    Animate(scene);
    return scene;
  }

 private:
  float Real(double lo, double hi) { return float(std::uniform_real_distribution<double>(lo, hi)(random_)); }

  static void Place(Node& node, const Trs& trs) {
    node.trs = trs;
    node.local = FromTrs(trs);
  }

  Primitive Sphere(int rings, double radius, bool normals) {
    const TriangleMesh sphere = testing::BumpySphere(rings, 7);
    Primitive out;
    out.triangles = sphere.triangles;
    for (const Vec3d& p : sphere.positions) {
      const double length = std::sqrt(Dot(p, p));
      out.positions.push_back({float(p.x * radius), float(p.y * radius), float(p.z * radius)});
      if (!normals) continue;
      const Vec3f n{float(p.x / length), float(p.y / length), float(p.z / length)};
      out.normals.push_back(n);
      out.tangents.push_back({n.y, -n.x, 0, out.normals.size() % 2 == 0 ? 1.0f : -1.0f});
    }
    return out;
  }

  Primitive Skinned() {
    Primitive out = Sphere(12, 8, true);
    for (const Vec3f& p : out.positions) {
      const float upper = Clamp(0.5f + p.y / 16, 0.0f, 1.0f);
      out.joints[0].push_back({0, 1, 0, 1});
      out.weights[0].push_back({1 - upper, upper, 0, Real(0, 0.25)});
      out.joints[1].push_back({1, 0, 0, 0});
      out.weights[1].push_back({Real(0, 0.125), 0, 0, 0});
    }
    return out;
  }

  Primitive Morphed() {
    Primitive out = Sphere(8, 5, true);
    MorphData rest{out.positions, out.normals, out.tangents, {}};
    for (const bool directions : {true, false}) {
      MorphTarget target;
      for (const Vec3f& p : out.positions) {
        target.positions.push_back({p.x * Real(0, 0.5), Real(-1, 1), 0});
        if (!directions) continue;
        target.normals.push_back({Real(-0.5, 0.5), 0, Real(-0.5, 0.5)});
        target.tangents.push_back({0, Real(-0.5, 0.5), 0});
      }
      rest.targets.push_back(std::move(target));
    }
    for (size_t v = 0; v < out.positions.size(); ++v) {  // the mesh's weights are .25 and 0
      const auto add = [&](Vec3f& to, const Vec3f& d) { AddDisplacement(0.25, d, to.x, to.y, to.z); };
      add(out.positions[v], rest.targets[0].positions[v]);
      add(out.normals[v], rest.targets[0].normals[v]);
      const Vec3f& d = rest.targets[0].tangents[v];
      AddDisplacement(0.25, d, out.tangents[v].x, out.tangents[v].y, out.tangents[v].z);
    }
    out.morph = std::make_shared<const MorphData>(std::move(rest));
    return out;
  }

  static void Animate(Scene& scene) {
    const std::vector<float> times = {0.25f, 1, 2};
    Animation all;
    all.samplers.push_back({Interpolation::kLinear, times, {12, 10, 12, 14, 10, 12, 12, 14, 10}, 3});
    all.samplers.push_back(
        {Interpolation::kLinear, times, {0.1305262f, 0, 0, 0.9914449f, 0, 0.3826834f, 0, 0.9238795f, 0, 0, 0, 1}, 4});
    all.samplers.push_back({Interpolation::kStep, times, {0.25f, 0, 1, 0.5f, 0, -0.75f}, 2});
    all.samplers.push_back({Interpolation::kCubicSpline,
                            times,
                            {0, 0, 0, 1, 1.25f, 1, 0, 1, 0, 0, 0, 0, 1.5f, 1, 1, 0, 0, 0, 0, 0, 0, 1, 1, 0.5f, 0, 0, 0},
                            3});
    all.channels = {{1, AnimationPath::kTranslation, 0},
                    {2, AnimationPath::kRotation, 1},
                    {4, AnimationPath::kWeights, 2},
                    {4, AnimationPath::kScale, 3}};
    Animation joints;
    joints.samplers = {all.samplers[1]};
    joints.channels = {{1, AnimationPath::kRotation, 0}};
    scene.animations = {std::move(all), std::move(joints)};
  }

  std::mt19937 random_;
};

}  // namespace

TriangleMesh RiggedMesh(uint32_t seed) {
  absl::StatusOr<TriangleMesh> mesh = Flatten(Maker(seed).Make());
  if (!mesh.ok() || mesh->rig == nullptr) std::abort();
  return *std::move(mesh);
}

}  // namespace voxelpipe::gpu
