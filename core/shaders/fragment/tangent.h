// tangent: the vertex tangents interpolated at the voxel's centre.
//
// Source: glTF 2.0 specification, section 3.7.2.1 (TANGENT).
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Output: f32, 4 components: x, y, z in world axes, unit length, not made orthogonal to the normal; w = 1 or -1, the
// handedness of the bitangent cross(normal, tangent) * w. Where the mesh has no tangents, or they cancel out: 0, 0, 0
// and w.
struct TangentShader : FragmentShaderTraits {
  static constexpr bool kIsFraction = true;
  static constexpr bool kNeedsBarycentrics = true;
  VOXELPIPE_HD static bool SameForTriangle(const FragmentInput& in) { return !in.part->has_tangents; }
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    if (!in.part->has_tangents) return;
    const Vec4f* tangents = in.mesh->tangents;
    const Vec4f t = Interpolate(in.barycentric, tangents[in.vertex[0]], tangents[in.vertex[1]], tangents[in.vertex[2]]);
    const Vec3f unit = Normalized(Vec3d{t.x, t.y, t.z});
    out.f[0] = unit.x;
    out.f[1] = unit.y;
    out.f[2] = unit.z;
    out.f[3] = t.w < 0 ? -1.0f : 1.0f;
  }
};

}  // namespace voxelpipe
