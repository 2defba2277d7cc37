// A vertex of a glTF primitive in a pose: morph targets, then joints or the node's transform.
// Source: glTF 2.0 specification, sections 3.7.2.2 (morph targets) and 3.7.3 (skins).
#pragma once

#include <cmath>
#include <cstdint>

#include "base/vec.h"

namespace voxelpipe {

// World space.
struct ShadedVertex {
  Vec3d position;
  Vec3f normal;    // unit length; 0 where the mesh has none
  Vec4f tangent;   // xyz unit length, w = handedness; 0 where the mesh has none
  Vec3d velocity;  // world units a second
};

// Displacements of one morph target, one a vertex, object space; null if the target does not displace that attribute.
struct MorphTargetView {
  const Vec3f* positions = nullptr;
  const Vec3f* normals = nullptr;
  const Vec3f* tangents = nullptr;
};

// A primitive before any pose, object space. Null pointers for attributes that it does not have.
struct RestPrimitiveView {
  const Vec3f* positions = nullptr;
  const Vec3f* normals = nullptr;
  const Vec4f* tangents = nullptr;
  const uint16_t (*joints[2])[4] = {nullptr, nullptr};
  const float (*weights[2])[4] = {nullptr, nullptr};
  const MorphTargetView* targets = nullptr;
  uint32_t target_count = 0;
};

struct PoseView {
  const double* target_weights = nullptr;  // one a morph target of the primitive
  const Mat4d* joints = nullptr;           // skinning matrices; null: not skinned
  uint32_t joint_count = 0;
  Mat4d world;            // of node and instance, unless skinned
  bool mirrored = false;  // flips the handedness of tangents
};

// A part of the mesh in the pose of a request, and `dt` seconds later if velocities are requested.
struct PosedPartView {
  RestPrimitiveView rest;
  PoseView pose, later;
};

// v / |v| in double, 0 if the length is 0 or not finite.
VOXELPIPE_HD Vec3f UnitOrZero(const Vec3d& v) {
  const double length = sqrt(Dot(v, v));
  if (!(length > 0) || !(length < HUGE_VAL)) return {};
  return {float(v.x / length), float(v.y / length), float(v.z / length)};
}

// The weighted sum of a vertex's joint matrices, weights normalized by their sum. `out` is not changed if the weights
// sum to 0. False if a joint with a weight does not exist.
VOXELPIPE_HD bool BlendJoints(const RestPrimitiveView& rest, const Mat4d* joints, uint32_t joint_count, uint64_t v,
                              Mat4d& out) {
  Mat4d sum;
  double total = 0;
  for (int i = 0; i < 16; ++i) sum.m[i / 4][i % 4] = 0;
  for (int set = 0; set < 2; ++set) {
    if (rest.joints[set] == nullptr || rest.weights[set] == nullptr) continue;
    for (int k = 0; k < 4; ++k) {
      const double weight = rest.weights[set][v][k];
      if (weight == 0) continue;
      const uint16_t joint = rest.joints[set][v][k];
      if (joint >= joint_count) return false;
      total += weight;
      for (int r = 0; r < 4; ++r) {
        for (int c = 0; c < 4; ++c) sum.m[r][c] += weight * joints[joint].m[r][c];
      }
    }
  }
  if (!(total > 0)) return true;
  for (int i = 0; i < 16; ++i) out.m[i / 4][i % 4] = sum.m[i / 4][i % 4] / total;
  return true;
}

VOXELPIPE_HD void AddDisplacement(double weight, const Vec3f& d, float& x, float& y, float& z) {
  x = float(x + weight * d.x);
  y = float(y + weight * d.y);
  z = float(z + weight * d.z);
}

// Vertex v of the primitive in a pose. Every target is rounded to float as the loader does for the file's own weights,
// so that the file's own pose gives the same vertex as Flatten. A joint that does not exist makes the position NaN; the
// loader rejects such files.
VOXELPIPE_HD ShadedVertex PoseVertex(const RestPrimitiveView& rest, const PoseView& pose, uint64_t v) {
  Vec3f p = rest.positions[v];
  Vec3f n = rest.normals != nullptr ? rest.normals[v] : Vec3f{};
  Vec4f t = rest.tangents != nullptr ? rest.tangents[v] : Vec4f{};
  for (uint32_t i = 0; i < rest.target_count; ++i) {
    const double weight = pose.target_weights[i];
    if (weight == 0) continue;
    const MorphTargetView& target = rest.targets[i];
    if (target.positions != nullptr) AddDisplacement(weight, target.positions[v], p.x, p.y, p.z);
    if (rest.normals != nullptr && target.normals != nullptr) AddDisplacement(weight, target.normals[v], n.x, n.y, n.z);
    if (rest.tangents != nullptr && target.tangents != nullptr) {
      AddDisplacement(weight, target.tangents[v], t.x, t.y, t.z);
    }
  }
  Mat4d m = pose.world;
  ShadedVertex out;
  if (pose.joints != nullptr && !BlendJoints(rest, pose.joints, pose.joint_count, v, m)) {
    const double zero = 0.0;
    out.position.x = zero / zero;
    return out;
  }
  out.position = TransformPoint(m, {p.x, p.y, p.z});
  if (rest.normals != nullptr) out.normal = UnitOrZero(TransformNormal(m, {n.x, n.y, n.z}));
  if (rest.tangents != nullptr) {
    const Vec3f unit = UnitOrZero(TransformVector(m, {t.x, t.y, t.z}));
    out.tangent = {unit.x, unit.y, unit.z, pose.mirrored ? -t.w : t.w};
  }
  return out;
}

}  // namespace voxelpipe
