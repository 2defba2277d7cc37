// attribute: a vertex attribute of the file's own.
//
// Source: glTF 2.0 specification, section 3.7.2.1 (application-specific attributes, whose names begin with an
// underscore).
#pragma once

#include "shaders/fragment.h"

namespace voxelpipe {

// Parameter name: the attribute's, "_TEMPERATURE" say, resolved when a run starts (shaders/resolve.h): value[0] is then
// its index in MeshView::attributes plus 1. Output: f32, as many components as the attribute has, interpolated, in the
// file's units; missing ones 0, the fourth 1. 0 in parts of the mesh without it; a mesh without it anywhere is an
// error.
struct AttributeShader : FragmentShaderTraits {
  static constexpr bool kNeedsBarycentrics = true;
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams& params, FragmentOutput& out) {
    const uint32_t index = uint32_t(params.value[0]);
    if (index == 0 || index > in.mesh->attribute_count) return;
    const AttributeView& attribute = in.mesh->attributes[index - 1];
    for (int c = 0; c < attribute.components; ++c) {
      const auto at = [&](int corner) {
        return attribute.values[uint64_t{in.vertex[corner]} * uint64_t(attribute.components) + uint64_t(c)];
      };
      out.f[c] = Interpolate(in.barycentric, at(0), at(1), at(2));
    }
  }
};

}  // namespace voxelpipe
