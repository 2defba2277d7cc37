// The built-in shaders. A new shader is one header and one line here, plus its description in catalog.cpp.
#pragma once

#include "shaders/fragment/attribute.h"
#include "shaders/fragment/barycentric.h"
#include "shaders/fragment/base_color.h"
#include "shaders/fragment/checker.h"
#include "shaders/fragment/color.h"
#include "shaders/fragment/constant.h"
#include "shaders/fragment/coverage_fraction.h"
#include "shaders/fragment/emissive.h"
#include "shaders/fragment/geometric_normal.h"
#include "shaders/fragment/label.h"
#include "shaders/fragment/material_id.h"
#include "shaders/fragment/mesh_id.h"
#include "shaders/fragment/metallic_roughness.h"
#include "shaders/fragment/normal.h"
#include "shaders/fragment/occupancy.h"
#include "shaders/fragment/packed_normal.h"
#include "shaders/fragment/position.h"
#include "shaders/fragment/tangent.h"
#include "shaders/fragment/triangle_id.h"
#include "shaders/fragment/uv.h"
#include "shaders/fragment/velocity.h"
#include "shaders/vertex/vertex_displace_along_normal.h"
#include "shaders/vertex/vertex_identity.h"
#include "shaders/vertex/vertex_morph.h"
#include "shaders/vertex/vertex_skin.h"
#include "shaders/vertex/vertex_transform.h"

#define VOXELPIPE_VERTEX_SHADERS(X) \
  X(Identity)                       \
  X(Transform)                      \
  X(DisplaceAlongNormal)            \
  X(Morph)                          \
  X(Skin)

// Device code that is compiled at run time may define a list of its own.
#if !defined(VOXELPIPE_FRAGMENT_SHADERS)
#define VOXELPIPE_FRAGMENT_SHADERS(X) \
  X(Occupancy)                        \
  X(Constant)                         \
  X(TriangleId)                       \
  X(Barycentric)                      \
  X(GeometricNormal)                  \
  X(Normal)                           \
  X(PackedNormal)                     \
  X(BaseColor)                        \
  X(Emissive)                         \
  X(MetallicRoughness)                \
  X(MaterialId)                       \
  X(MeshId)                           \
  X(Tangent)                          \
  X(Uv)                               \
  X(Color)                            \
  X(Attribute)                        \
  X(Velocity)                         \
  X(Position)                         \
  X(CoverageFraction)                 \
  X(Checker)                          \
  X(Label)
#endif

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

// FragmentShaderTraits::SameForTriangle of a shader chosen at run time. In: a triangle's input, its voxel and
// barycentrics not yet set.
VOXELPIPE_HD bool SameForTriangle(FragmentShaderId id, const FragmentInput& in) {
  switch (id) {
#define VOXELPIPE_CASE(name) \
  case FragmentShaderId::k##name: return name##Shader::SameForTriangle(in);
    VOXELPIPE_FRAGMENT_SHADERS(VOXELPIPE_CASE)
#undef VOXELPIPE_CASE
  }
  return false;
}

// FragmentShaderTraits::MayDiscard of a shader chosen at run time.
VOXELPIPE_HD bool MayDiscard(FragmentShaderId id, const MaterialView& material) {
  switch (id) {
#define VOXELPIPE_CASE(name) \
  case FragmentShaderId::k##name: return name##Shader::MayDiscard(material);
    VOXELPIPE_FRAGMENT_SHADERS(VOXELPIPE_CASE)
#undef VOXELPIPE_CASE
  }
  return true;
}

// FragmentShaderTraits of a shader chosen at run time, or the union over several (operator|=).
struct ShaderTraits {
  bool needs_barycentrics = false, can_discard = false, is_color = false, is_fraction = false;
  bool reads_base_color = false, reads_emissive = false, reads_metallic_roughness = false;
  bool needs_plane = false;

  VOXELPIPE_HD bool reads_textures() const { return reads_base_color || reads_emissive || reads_metallic_roughness; }
  VOXELPIPE_HD ShaderTraits& operator|=(const ShaderTraits& other) {
    needs_barycentrics = needs_barycentrics || other.needs_barycentrics;
    can_discard = can_discard || other.can_discard;
    is_color = is_color || other.is_color;
    is_fraction = is_fraction || other.is_fraction;
    reads_base_color = reads_base_color || other.reads_base_color;
    reads_emissive = reads_emissive || other.reads_emissive;
    reads_metallic_roughness = reads_metallic_roughness || other.reads_metallic_roughness;
    needs_plane = needs_plane || other.needs_plane;
    return *this;
  }
};

VOXELPIPE_HD ShaderTraits TraitsOf(FragmentShaderId id) {
  switch (id) {
#define VOXELPIPE_CASE(name)                       \
  case FragmentShaderId::k##name:                  \
    return {name##Shader::kNeedsBarycentrics,      \
            name##Shader::kCanDiscard,             \
            name##Shader::kIsColor,                \
            name##Shader::kIsFraction,             \
            name##Shader::kReadsBaseColor,         \
            name##Shader::kReadsEmissive,          \
            name##Shader::kReadsMetallicRoughness, \
            name##Shader::kNeedsPlane};
    VOXELPIPE_FRAGMENT_SHADERS(VOXELPIPE_CASE)
#undef VOXELPIPE_CASE
  }
  return {};
}

// Runs the shader, then adds the velocity of the rigid motion, whose parameters follow the shader's own.
VOXELPIPE_HD ShadedVertex ShadeVertex(VertexShaderId id, const VertexInput& in, const ShaderParams& params) {
  ShadedVertex out = in.flat;
  switch (id) {
#define VOXELPIPE_CASE(name)                                                                              \
  case VertexShaderId::k##name:                                                                           \
    static_assert(name##VertexShader::kParameters + RigidMotion::kParameters <= ShaderParams::kCapacity); \
    out = name##VertexShader::Shade(in, params);                                                          \
    RigidMotion::Add(params.value + name##VertexShader::kParameters, out);                                \
    break;
    VOXELPIPE_VERTEX_SHADERS(VOXELPIPE_CASE)
#undef VOXELPIPE_CASE
  }
  return out;
}

}  // namespace voxelpipe
