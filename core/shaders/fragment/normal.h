// normal: the vertex normals interpolated at the voxel's centre.
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Output: f32, 3 components, world axes, unit length; the geometric normal where the mesh has no normals.
struct NormalShader : FragmentShaderTraits {
  static constexpr bool kIsFraction = true;
  static constexpr bool kNeedsBarycentrics = true;
  VOXELPIPE_HD static bool SameForTriangle(const FragmentInput& in) { return !in.part->has_normals; }
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    const Vec3f n = ShadingNormal(in);
    out.f[0] = n.x;
    out.f[1] = n.y;
    out.f[2] = n.z;
  }
};

}  // namespace voxelpipe
