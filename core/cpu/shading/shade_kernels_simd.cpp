// Compiles the vector kernels for each instruction set, by Google Highway's foreach_target.h.
#include "cpu/shading/shade_kernels_simd.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <optional>

#include "shaders/shader_list.h"

// As of the row kernels (cpu/rows/row_kernels_simd.cpp).
#undef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX3 | HWY_AVX2 | HWY_EMU128 | HWY_SCALAR))
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "cpu/shading/shade_kernels_simd.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h, which includes this file again for each target.
#include <hwy/highway.h>

#include "cpu/shading/convert_lanes-inl.h"
#include "cpu/shading/place_lanes-inl.h"
#include "cpu/shading/texture_lanes-inl.h"
#include "cpu/shading/vertex_lanes-inl.h"

#if HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3
HWY_BEFORE_NAMESPACE();
namespace voxelpipe::cpu {
namespace HWY_NAMESPACE {

// The shaders whose fragments of a triangle differ. Of those without vectors, `coverage_fraction` clips polygons and
// `checker` costs nothing.
bool ShadeBatch(FragmentShaderId shader, const FragmentBatch& batch, const ShaderParams& params, ShadedBatch& out) {
  const MeshView& mesh = *batch.mesh;
  const PartView& part = *batch.part;
  const MaterialView& material = mesh.materials[part.material];
  switch (shader) {
    case FragmentShaderId::kBaseColor:
      if (!MaterialSampler::Fits(batch, material.base_color)) return false;
      ShadeBaseColor(batch, material, out);
      return true;
    case FragmentShaderId::kEmissive:
    case FragmentShaderId::kMetallicRoughness: {
      const bool emissive = shader == FragmentShaderId::kEmissive;
      const TextureRefView& own = emissive ? material.emissive : material.metallic_roughness;
      if (!MaterialSampler::Fits(batch, own)) return false;
      if (material.alpha_mask && !MaterialSampler::Fits(batch, material.base_color)) return false;
      (emissive ? ShadeEmissive : ShadeMetallicRoughness)(batch, material, out);
      return true;
    }
    default: break;
  }
  KeepAll(batch, out);
  switch (shader) {
    case FragmentShaderId::kBarycentric: ShadeBarycentrics(batch, out); return true;
    case FragmentShaderId::kPosition: ShadePositions(batch, out); return true;
    case FragmentShaderId::kNormal:
      if (part.has_normals) ShadeNormals(batch, out);
      return part.has_normals;
    case FragmentShaderId::kPackedNormal:
      if (!part.has_normals) return false;
      ShadeNormals(batch, out);
      for (int i = 0; i < batch.count; ++i) out.u[0][i] = PackNormal({out.f[0][i], out.f[1][i], out.f[2][i]});
      for (int i = 0; i < batch.count; ++i) {
        out.u[1][i] = out.u[2][i] = 0;
        out.u[3][i] = 1;
      }
      return true;
    case FragmentShaderId::kTangent:
      if (part.has_tangents) ShadeTangents(batch, out);
      return part.has_tangents;
    case FragmentShaderId::kColor:
      if (part.has_colors) ShadeColors(batch, out);
      return part.has_colors;
    case FragmentShaderId::kVelocity:
      if (mesh.velocities != nullptr) ShadeVelocities(batch, out);
      return mesh.velocities != nullptr;
    case FragmentShaderId::kUv: {
      const int set = params.value[0] == 1 ? 1 : 0;
      if (part.has_uv[set]) ShadeUv(batch, set, out);
      return part.has_uv[set];
    }
    case FragmentShaderId::kAttribute: {
      const auto index = uint32_t(params.value[0]);
      if (index == 0 || index > mesh.attribute_count || mesh.attributes[index - 1].run_count != 0) return false;
      ShadeAttribute(batch, mesh.attributes[index - 1], out);
      return true;
    }
    default: return false;
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace voxelpipe::cpu
HWY_AFTER_NAMESPACE();
#endif  // HWY_TARGET

#if HWY_ONCE
namespace voxelpipe::cpu {

const ShadeKernels* Avx2ShadeKernels() {
#if (HWY_TARGETS & HWY_AVX2)
  static constexpr ShadeKernels kKernels{N_AVX2::PlaceBatch, N_AVX2::ShadeBatch, N_AVX2::ToCells, N_AVX2::ToTerms};
  return &kKernels;
#else
  return nullptr;
#endif
}

const ShadeKernels* Avx512ShadeKernels() {
#if (HWY_TARGETS & HWY_AVX3)
  static constexpr ShadeKernels kKernels{N_AVX3::PlaceBatch, N_AVX3::ShadeBatch, N_AVX3::ToCells, N_AVX3::ToTerms};
  return &kKernels;
#else
  return nullptr;
#endif
}

}  // namespace voxelpipe::cpu
#endif  // HWY_ONCE
