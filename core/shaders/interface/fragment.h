// Input and output of a fragment shader.
#pragma once

#include <cmath>
#include <cstdint>

#include "base/vec.h"
#include "mesh/views/mesh_view.h"
#include "shaders/interface/shader_params.h"

namespace voxelpipe {

// One fragment: a triangle and a voxel that it covers. Positions and normals are in world units and axes.
struct FragmentInput {
  const MeshView* mesh = nullptr;
  const PartView* part = nullptr;
  uint32_t triangle = 0;    // triangle id
  uint32_t vertex[3] = {};  // vertex indices of the triangle
  bool degenerate = false;  // by the definition of raster/coverage.h, in index space
  Vec3f geometric_normal;   // unit length, right-handed winding of the shaded vertices; 0 if degenerate
  int64_t voxel[3] = {};    // grid coordinates
  Vec3f barycentric;        // of the voxel's centre; set only if the shader's traits ask for them
  // Per texture coordinate set: uv along a voxel (fragment_input.h); set only if the shader samples textures.
  float uv_density[2] = {};

  VOXELPIPE_HD const MaterialView& material() const { return mesh->materials[part->material]; }
};

// What a fragment shader needs and may do. Each shader derives from this and overrides what differs.
struct FragmentShaderTraits {
  static constexpr bool kNeedsPlane = true;  // reads `degenerate`, `geometric_normal`, `uv_density` or barycentrics
  static constexpr bool kNeedsBarycentrics = false;
  static constexpr bool kCanDiscard = false;  // may set FragmentOutput::discard
  // True if it may discard fragments of this material.
  VOXELPIPE_HD static bool MayDiscard(const MaterialView&) { return false; }
  static constexpr bool kIsColor = false;     // 0 to 1 a channel: integer targets scale it to their range by default
  static constexpr bool kIsFraction = false;  // gives fractions: integers without a scale keep whole numbers
  // Textures of the material that it samples.
  static constexpr bool kReadsBaseColor = false, kReadsEmissive = false, kReadsMetallicRoughness = false;
  // True if all fragments of a triangle have the same output, whatever their `voxel` and `barycentric`. Depends on the
  // mesh and its part alone, not on the triangle.
  VOXELPIPE_HD static bool SameForTriangle(const FragmentInput&) { return false; }
};

// Up to four components, all f32 or all u32 as the shader's output type says. Missing components read as 0, the fourth
// 1.
struct FragmentOutput {
  float f[4] = {0, 0, 0, 1};
  uint32_t u[4] = {0, 0, 0, 1};
  bool discard = false;  // drop the fragment: the target is not written
};

VOXELPIPE_HD float Interpolate(const Vec3f& b, float v0, float v1, float v2) {
  return (b.x * v0 + b.y * v1) + b.z * v2;
}
VOXELPIPE_HD Vec2f Interpolate(const Vec3f& b, const Vec2f& v0, const Vec2f& v1, const Vec2f& v2) {
  return {Interpolate(b, v0.x, v1.x, v2.x), Interpolate(b, v0.y, v1.y, v2.y)};
}
VOXELPIPE_HD Vec3f Interpolate(const Vec3f& b, const Vec3f& v0, const Vec3f& v1, const Vec3f& v2) {
  return {Interpolate(b, v0.x, v1.x, v2.x), Interpolate(b, v0.y, v1.y, v2.y), Interpolate(b, v0.z, v1.z, v2.z)};
}
VOXELPIPE_HD Vec4f Interpolate(const Vec3f& b, const Vec4f& v0, const Vec4f& v1, const Vec4f& v2) {
  return {Interpolate(b, v0.x, v1.x, v2.x), Interpolate(b, v0.y, v1.y, v2.y), Interpolate(b, v0.z, v1.z, v2.z),
          Interpolate(b, v0.w, v1.w, v2.w)};
}

// v / |v|, or 0 where the length is 0 or not finite.
VOXELPIPE_HD Vec3f Normalized(const Vec3d& v) {
  const double largest = Max(Abs(v.x), Max(Abs(v.y), Abs(v.z)));
  if (!(largest > 0) || !(largest < HUGE_VAL)) return {};
  const Vec3d s{v.x / largest, v.y / largest, v.z / largest};  // no overflow in the squares
  const double length = sqrt(Dot(s, s));
  return {float(s.x / length), float(s.y / length), float(s.z / length)};
}

// The unit normal of a triangle by its winding, 0 if it has no area.
VOXELPIPE_HD Vec3f TriangleNormal(const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  return Normalized(Cross(b - a, c - a));
}

// The interpolated vertex normal, unit length; the geometric normal where the mesh has none or they cancel out.
VOXELPIPE_HD Vec3f ShadingNormal(const FragmentInput& in) {
  if (!in.part->has_normals) return in.geometric_normal;
  const Vec3f* normals = in.mesh->normals;
  const Vec3f n = Interpolate(in.barycentric, normals[in.vertex[0]], normals[in.vertex[1]], normals[in.vertex[2]]);
  const Vec3f unit = Normalized(Vec3d{n.x, n.y, n.z});
  const bool zero = unit.x == 0 && unit.y == 0 && unit.z == 0;
  return zero ? in.geometric_normal : unit;
}

}  // namespace voxelpipe
