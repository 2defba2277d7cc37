// attribute: an application-specific vertex attribute of the file.
//
// Source: glTF 2.0 specification, section 3.7.2.1 (application-specific attributes, whose names begin with an
// underscore).
#pragma once

#include "shaders/interface/fragment.h"

namespace voxelpipe {

// Parameter name: the attribute's, "_TEMPERATURE" say, resolved when a run starts (shaders/resolve.h): value[0] is then
// its index in MeshView::attributes plus 1. Output: f32, as many components as the attribute has, interpolated, in the
// file's units; missing ones are 0, the fourth 1. 0 in parts of the mesh without the attribute; an error if no part has
// it.
struct AttributeShader : FragmentShaderTraits {
  static constexpr bool kNeedsBarycentrics = true;
  VOXELPIPE_HD static void Shade(const FragmentInput& in, const ShaderParams& params, FragmentOutput& out) {
    const uint32_t index = uint32_t(params.value[0]);
    if (index == 0 || index > in.mesh->attribute_count) return;
    const AttributeView& attribute = in.mesh->attributes[index - 1];
    // The vertices of a triangle belong to one part: all have values, or none has.
    const float* const values[3] = {ValuesOf(attribute, in.vertex[0]), ValuesOf(attribute, in.vertex[1]),
                                    ValuesOf(attribute, in.vertex[2])};
    for (int c = 0; c < attribute.components; ++c) {
      out.f[c] = values[0] == nullptr ? 0.0f : Interpolate(in.barycentric, values[0][c], values[1][c], values[2][c]);
    }
  }
};

}  // namespace voxelpipe
