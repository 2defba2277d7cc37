// material_id: the glTF material of the triangle.
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Output: u32, 1 component: the material's index in the file. glTF's default material, which primitives without a
// material have, comes after the last: its id is the number of materials. Files without materials: 0.
struct MaterialIdShader : FragmentShaderTraits {
  static constexpr bool kNeedsPlane = false;
  VOXELPIPE_HD static bool SameForTriangle(const FragmentInput&) { return true; }
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    out.u[0] = uint32_t(in.part->material);
  }
};

}  // namespace voxelpipe
