// Interpolated vertex data on vectors: shaders/interface/fragment.h and the shaders of fragment/ that read vertices
// alone, operation by operation. Included once for each instruction set; no include guard but Highway's.
#if defined(VOXELPIPE_VERTEX_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef VOXELPIPE_VERTEX_LANES_INL_H_
#undef VOXELPIPE_VERTEX_LANES_INL_H_
#else
#define VOXELPIPE_VERTEX_LANES_INL_H_
#endif

#include "cpu/shading/place_lanes-inl.h"
#include "cpu/shading/shade_kernels.h"

#if HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3

HWY_BEFORE_NAMESPACE();
namespace voxelpipe::cpu {
namespace HWY_NAMESPACE {

HWY_INLINE VHF SetHF(float v) {
  return hn::Set(DHF(), v);
}

// kHalf fragments of a batch, from fragment `at` on.
struct Fragments {
  const FragmentBatch& batch;
  int at;
  VHI triangle;  // index in the batch
  VHI vertex[3];
  VHF barycentric[3];
};
HWY_INLINE Fragments FragmentsAt(const FragmentBatch& batch, int at) {
  const DHI di;
  const DHF df;
  Fragments out{batch, at, hn::Load(di, batch.triangle_of + at), {}, {}};
  for (int k = 0; k < 3; ++k) {
    out.vertex[k] = hn::GatherIndex(di, batch.vertex[k], out.triangle);
    out.barycentric[k] = hn::Load(df, batch.barycentric[k] + at);
  }
  return out;
}

// Interpolate of fragment.h.
HWY_INLINE VHF Weighed(const Fragments& in, VHF v0, VHF v1, VHF v2) {
  return hn::Add(hn::Add(hn::Mul(in.barycentric[0], v0), hn::Mul(in.barycentric[1], v1)),
                 hn::Mul(in.barycentric[2], v2));
}
// Component c of vertex data of kStride floats a vertex, interpolated.
template <int kStride>
HWY_INLINE VHF Interpolated(const Fragments& in, const void* data, int c) {
  const DHF df;
  const auto floats = static_cast<const float*>(data) + c;
  VHF v[3];
  for (int k = 0; k < 3; ++k) {
    v[k] = hn::GatherIndex(df, floats, hn::Mul(in.vertex[k], hn::Set(DHI(), kStride)));
  }
  return Weighed(in, v[0], v[1], v[2]);
}

struct Vec3F {
  VHF x, y, z;
};
// Normalized of fragment.h.
HWY_INLINE Vec3F NormalizedLanes(const Vec3F& v) {
  const DD d;
  const DHF df;
  const Vec3D wide{hn::PromoteTo(d, v.x), hn::PromoteTo(d, v.y), hn::PromoteTo(d, v.z)};
  const VD largest = MaxAbsD(wide);
  const MD valid = hn::And(hn::Gt(largest, hn::Zero(d)), hn::Lt(largest, hn::Set(d, HUGE_VAL)));
  const Vec3D s{hn::Div(wide.x, largest), hn::Div(wide.y, largest), hn::Div(wide.z, largest)};
  const VD length = hn::Sqrt(Dot3(s, s));
  const auto unit = [&](VD part)
                        HWY_ATTR { return hn::DemoteTo(df, hn::IfThenElseZero(valid, hn::Div(part, length))); };
  return {unit(s.x), unit(s.y), unit(s.z)};
}

HWY_INLINE void StoreOutput(ShadedBatch& out, int at, VHF f0, VHF f1, VHF f2, VHF f3) {
  const DHF df;
  hn::Store(f0, df, out.f[0] + at);
  hn::Store(f1, df, out.f[1] + at);
  hn::Store(f2, df, out.f[2] + at);
  hn::Store(f3, df, out.f[3] + at);
}

HWY_INLINE void KeepAll(const FragmentBatch& batch, ShadedBatch& out) {
  std::memset(out.discard, 0, size_t(batch.count) * sizeof out.discard[0]);
}

// The geometric normal of a fragment's triangle, where the interpolated one is 0.
HWY_INLINE void UseGeometricNormal(const FragmentBatch& batch, int at, ShadedBatch& out) {
  const int t = batch.triangle_of[at];
  Vec3f n;
  if (batch.degenerate[t] == 0) {
    const Vec3d* p = batch.mesh->positions;
    n = TriangleNormal(p[batch.vertex[0][t]], p[batch.vertex[1][t]], p[batch.vertex[2][t]]);
  }
  for (int c = 0; c < 3; ++c) out.f[c][at] = n[c];
}

// ShadingNormal, into the first three components.
HWY_ATTR void ShadeNormals(const FragmentBatch& batch, ShadedBatch& out) {
  const DHF df;
  const void* const normals = batch.mesh->normals;
  const VHF zero = hn::Zero(df), one = SetHF(1);
  for (int i = 0; i < batch.count; i += kHalf) {
    const Fragments in = FragmentsAt(batch, i);
    const Vec3F unit = NormalizedLanes(
        {Interpolated<3>(in, normals, 0), Interpolated<3>(in, normals, 1), Interpolated<3>(in, normals, 2)});
    StoreOutput(out, i, unit.x, unit.y, unit.z, one);
    const auto none = hn::And(hn::Eq(unit.x, zero), hn::And(hn::Eq(unit.y, zero), hn::Eq(unit.z, zero)));
    if (HWY_LIKELY(hn::AllFalse(df, none))) continue;
    for (uint64_t left = Bits(df, none); left != 0; left &= left - 1) {
      UseGeometricNormal(batch, i + std::countr_zero(left), out);
    }
  }
}

HWY_ATTR void ShadeTangents(const FragmentBatch& batch, ShadedBatch& out) {
  const void* const tangents = batch.mesh->tangents;
  for (int i = 0; i < batch.count; i += kHalf) {
    const Fragments in = FragmentsAt(batch, i);
    const Vec3F unit = NormalizedLanes(
        {Interpolated<4>(in, tangents, 0), Interpolated<4>(in, tangents, 1), Interpolated<4>(in, tangents, 2)});
    const VHF side = Interpolated<4>(in, tangents, 3);
    StoreOutput(out, i, unit.x, unit.y, unit.z, hn::IfThenElse(hn::Lt(side, hn::Zero(DHF())), SetHF(-1), SetHF(1)));
  }
}

// kComponents of vertex data of kStride floats a vertex; the others as FragmentOutput has them.
template <int kStride, int kComponents>
HWY_INLINE void ShadeVertexData(const FragmentBatch& batch, const void* data, ShadedBatch& out) {
  const VHF zero = hn::Zero(DHF());
  for (int i = 0; i < batch.count; i += kHalf) {
    const Fragments in = FragmentsAt(batch, i);
    StoreOutput(out, i, Interpolated<kStride>(in, data, 0),
                kComponents > 1 ? Interpolated<kStride>(in, data, kComponents > 1 ? 1 : 0) : zero,
                kComponents > 2 ? Interpolated<kStride>(in, data, kComponents > 2 ? 2 : 0) : zero,
                kComponents > 3 ? Interpolated<kStride>(in, data, kComponents > 3 ? 3 : 0) : SetHF(1));
  }
}
HWY_ATTR void ShadeUv(const FragmentBatch& batch, int set, ShadedBatch& out) {
  ShadeVertexData<2, 2>(batch, batch.mesh->uv[set], out);
}
HWY_ATTR void ShadeColors(const FragmentBatch& batch, ShadedBatch& out) {
  ShadeVertexData<4, 4>(batch, batch.mesh->colors, out);
}
HWY_ATTR void ShadeVelocities(const FragmentBatch& batch, ShadedBatch& out) {
  ShadeVertexData<3, 3>(batch, batch.mesh->velocities, out);
}
// All vertices have values.
HWY_ATTR void ShadeAttribute(const FragmentBatch& batch, const AttributeView& attribute, ShadedBatch& out) {
  switch (attribute.components) {
    case 1: return ShadeVertexData<1, 1>(batch, attribute.values, out);
    case 2: return ShadeVertexData<2, 2>(batch, attribute.values, out);
    case 3: return ShadeVertexData<3, 3>(batch, attribute.values, out);
    default: return ShadeVertexData<4, 4>(batch, attribute.values, out);
  }
}

HWY_ATTR void ShadeBarycentrics(const FragmentBatch& batch, ShadedBatch& out) {
  const DHF df;
  for (int i = 0; i < batch.count; i += kHalf) {
    StoreOutput(out, i, hn::Load(df, batch.barycentric[0] + i), hn::Load(df, batch.barycentric[1] + i),
                hn::Load(df, batch.barycentric[2] + i), SetHF(1));
  }
}

// fragment/position.h.
HWY_ATTR void ShadePositions(const FragmentBatch& batch, ShadedBatch& out) {
  const DD d;
  const DHF df;
  for (int i = 0; i < batch.count; i += kHalf) {
    const Fragments in = FragmentsAt(batch, i);
    const Vec3D v0 = GatherVec3d(batch.mesh->positions, in.vertex[0]);
    const Vec3D e1 = GatherVec3d(batch.mesh->positions, in.vertex[1]) - v0;
    const Vec3D e2 = GatherVec3d(batch.mesh->positions, in.vertex[2]) - v0;
    const Vec3D at = v0 + (e1 * hn::PromoteTo(d, in.barycentric[1]) + e2 * hn::PromoteTo(d, in.barycentric[2]));
    StoreOutput(out, i, hn::DemoteTo(df, at.x), hn::DemoteTo(df, at.y), hn::DemoteTo(df, at.z), SetHF(1));
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace voxelpipe::cpu
HWY_AFTER_NAMESPACE();

#endif  // HWY_TARGET
#endif  // include guard
