// mesh_id: the glTF mesh of the triangle.
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Output: u32, 1 component: the mesh's index in the file, the same for all its instances. A Draco stream is mesh 0.
struct MeshIdShader : FragmentShaderTraits {
  static constexpr bool kNeedsPlane = false;
  VOXELPIPE_HD static bool SameForTriangle(const FragmentInput&) { return true; }
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams&, FragmentOutput& out) {
    out.u[0] = in.part->mesh;
  }
};

}  // namespace voxelpipe
