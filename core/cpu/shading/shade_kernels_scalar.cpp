// The kernels in plain C++, which the vector kernels repeat lane by lane, and the choice among all.
#include "cpu/shading/shade_kernels_simd.h"
#include "raster/triangle_plane.h"
#include "shaders/blend_ops.h"
#include "shaders/interface/fragment_input.h"

namespace voxelpipe::cpu {
namespace {

void Place(FragmentBatch& batch) {
  TrianglePlane plane;
  int placed = -1;
  for (int i = 0; i < batch.count; ++i) {
    const int t = batch.triangle_of[i];
    if (t != placed) {
      const uint32_t* v = batch.mesh->triangles[batch.triangle[t]];
      const Vec3d* p = batch.mesh->index_positions;
      plane = SetUpPlane(p[v[0]], p[v[1]], p[v[2]]);
      batch.degenerate[t] = plane.degenerate ? ~0u : 0;
      placed = t;
    }
    const Vec3f b = Barycentrics(plane, batch.voxel[0][i], batch.voxel[1][i], batch.voxel[2][i]);
    batch.barycentric[0][i] = b.x;
    batch.barycentric[1][i] = b.y;
    batch.barycentric[2][i] = b.z;
  }
}

constexpr ShadeKernels kScalar{
    Place, [](FragmentShaderId, const FragmentBatch&, const ShaderParams&, ShadedBatch&) { return false; },
    ToCellsOneByOne, ToTermsOneByOne};

}  // namespace

void ShadeOneByOne(FragmentShaderId shader, const FragmentBatch& batch, const ShaderParams& params, ShadedBatch& out) {
  const ShaderTraits traits = TraitsOf(shader);
  FragmentInput in;
  int made = -1;
  for (int i = 0; i < batch.count; ++i) {
    const int t = batch.triangle_of[i];
    if (t != made) {
      const uint32_t triangle = batch.triangle[t];
      in = traits.needs_plane
               ? MakeFragmentInput(*batch.mesh, triangle, batch.degenerate[t] != 0, traits.reads_textures())
               : MakePlainInput(*batch.mesh, triangle);
      made = t;
    }
    for (int a = 0; a < 3; ++a) in.voxel[a] = batch.voxel[a][i];
    if (traits.needs_barycentrics) {
      in.barycentric = {batch.barycentric[0][i], batch.barycentric[1][i], batch.barycentric[2][i]};
    }
    FragmentOutput one;
    ShadeFragment(shader, in, params, one);
    for (int c = 0; c < 4; ++c) {
      out.f[c][i] = one.f[c];
      out.u[c][i] = one.u[c];
    }
    out.discard[i] = one.discard ? ~0u : 0;
  }
}

FragmentOutput OutputOf(const ShadedBatch& shaded, bool is_u32, int i) {
  FragmentOutput out;
  for (int c = 0; c < 4; ++c) {
    if (is_u32) {
      out.u[c] = shaded.u[c][i];
    } else {
      out.f[c] = shaded.f[c][i];
    }
  }
  out.discard = shaded.discard[i] != 0;
  return out;
}

void ToCellsOneByOne(const ShadedBatch& shaded, int count, const ConversionRules& rules, BatchCells& cells) {
  for (int i = 0; i < count; ++i) {
    const FragmentOutput out = OutputOf(shaded, rules.is_u32, i);
    for (int c = 0; c < rules.components; ++c) {
      cells[c][i] = ToCell(out, rules.is_u32, c, rules.format, rules.scale);
    }
  }
}

void ToTermsOneByOne(const ShadedBatch& shaded, int count, const ConversionRules& rules, BatchTerms& terms) {
  for (int i = 0; i < count; ++i) {
    const FragmentOutput out = OutputOf(shaded, rules.is_u32, i);
    for (int c = 0; c < rules.components; ++c) {
      terms[c][i] = ToTerm(out, rules.is_u32, c, rules.format, rules.scale, rules.quantum);
    }
  }
}

const ShadeKernels& ShadeKernelsNamed(std::string_view name) {
  const ShadeKernels* kernels = nullptr;
  if (name == "avx2") kernels = Avx2ShadeKernels();
  if (name == "avx512") kernels = Avx512ShadeKernels();
  return kernels != nullptr ? *kernels : kScalar;
}

}  // namespace voxelpipe::cpu
