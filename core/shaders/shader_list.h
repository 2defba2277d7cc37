// The built-in shaders. A new fragment shader is one header and one line here, plus its description in catalog.cpp.
#pragma once

#include "shaders/barycentric.h"
#include "shaders/base_color.h"
#include "shaders/constant.h"
#include "shaders/geometric_normal.h"
#include "shaders/normal.h"
#include "shaders/occupancy.h"
#include "shaders/packed_normal.h"
#include "shaders/triangle_id.h"
#include "shaders/vertex_shaders.h"

#define VOXELPIPE_VERTEX_SHADERS(X) \
  X(Identity)                       \
  X(Transform)

#define VOXELPIPE_FRAGMENT_SHADERS(X) \
  X(Occupancy)                        \
  X(Constant)                         \
  X(TriangleId)                       \
  X(Barycentric)                      \
  X(GeometricNormal)                  \
  X(Normal)                           \
  X(PackedNormal)                     \
  X(BaseColor)

namespace voxelpipe {

#define VOXELPIPE_ENUMERATOR(name) k##name,
enum class VertexShaderId : int { VOXELPIPE_VERTEX_SHADERS(VOXELPIPE_ENUMERATOR) };
enum class FragmentShaderId : int { VOXELPIPE_FRAGMENT_SHADERS(VOXELPIPE_ENUMERATOR) };
#undef VOXELPIPE_ENUMERATOR

// One uniform switch per fragment: every fragment of a target takes the same branch.
VOXELPIPE_HD void ShadeFragment(FragmentShaderId id, const FragmentInput& in, const ShaderParams& params,
                                FragmentOutput& out) {
  switch (id) {
#define VOXELPIPE_CASE(name) \
  case FragmentShaderId::k##name: return name##Shader::Shade(in, params, out);
    VOXELPIPE_FRAGMENT_SHADERS(VOXELPIPE_CASE)
#undef VOXELPIPE_CASE
  }
}

VOXELPIPE_HD bool NeedsBarycentrics(FragmentShaderId id) {
  switch (id) {
#define VOXELPIPE_CASE(name) \
  case FragmentShaderId::k##name: return name##Shader::kNeedsBarycentrics;
    VOXELPIPE_FRAGMENT_SHADERS(VOXELPIPE_CASE)
#undef VOXELPIPE_CASE
  }
  return false;
}

VOXELPIPE_HD ShadedVertex ShadeVertex(VertexShaderId id, const ShadedVertex& in, const ShaderParams& params) {
  switch (id) {
#define VOXELPIPE_CASE(name) \
  case VertexShaderId::k##name: return name##VertexShader::Shade(in, params);
    VOXELPIPE_VERTEX_SHADERS(VOXELPIPE_CASE)
#undef VOXELPIPE_CASE
  }
  return in;
}

}  // namespace voxelpipe
