// Input and output of a vertex shader.
#pragma once

#include "base/vec.h"
#include "mesh/scene/vertex_pose.h"
#include "shaders/interface/fragment.h"
#include "shaders/interface/shader_params.h"

namespace voxelpipe {

// One vertex of the flattened mesh, and the data to pose it again.
struct VertexInput {
  ShadedVertex flat;                     // from Flatten: the file's own pose; normal and tangent 0 where there are none
  const PosedPartView* posed = nullptr;  // null: the request has no other pose, or the vertex has none
  uint64_t vertex = 0;                   // index within the part
};

// The parameters that every vertex shader has after its own. They add the velocity of a rigid body, v = linear_velocity
// + angular_velocity x (p - center). World units a second, radians a second, p the shaded position.
struct RigidMotion {
  static constexpr int kParameters = 9;  // linear_velocity, angular_velocity, center
  // The velocity at p.
  VOXELPIPE_HD static Vec3d At(const double* parameters, const Vec3d& p) {
    const Vec3d linear{parameters[0], parameters[1], parameters[2]};
    const Vec3d angular{parameters[3], parameters[4], parameters[5]};
    const Vec3d center{parameters[6], parameters[7], parameters[8]};
    return linear + Cross(angular, p - center);
  }
  VOXELPIPE_HD static void Add(const double* parameters, ShadedVertex& vertex) {
    vertex.velocity = vertex.velocity + At(parameters, vertex.position);
  }
};

// Velocity between two poses, (to - from) / dt; 0 where dt is 0, which means that the request has no second pose.
VOXELPIPE_HD Vec3d VelocityBetween(const Vec3d& from, const Vec3d& to, double dt) {
  if (!(dt > 0)) return {};
  const Vec3d d = to - from;
  return {d.x / dt, d.y / dt, d.z / dt};
}

// The vertex in the request's pose, with the velocity towards the pose `dt` seconds later. Without a pose in the
// request: the vertex from Flatten.
VOXELPIPE_HD ShadedVertex ShadePosed(const VertexInput& in, double dt) {
  if (in.posed == nullptr) return in.flat;
  ShadedVertex out = PoseVertex(in.posed->rest, in.posed->pose, in.vertex);
  if (dt > 0) {
    const ShadedVertex later = PoseVertex(in.posed->rest, in.posed->later, in.vertex);
    out.velocity = VelocityBetween(out.position, later.position, dt);
  }
  return out;
}

}  // namespace voxelpipe
