// ShadeKernels::place on vectors: raster/triangle_plane.h operation by operation. Included once for each instruction
// set; no include guard but Highway's.
#if defined(VOXELPIPE_PLACE_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef VOXELPIPE_PLACE_LANES_INL_H_
#undef VOXELPIPE_PLACE_LANES_INL_H_
#else
#define VOXELPIPE_PLACE_LANES_INL_H_
#endif

#include "cpu/rows/row_lanes-inl.h"
#include "cpu/shading/fragment_batch.h"
#include "raster/triangle_plane.h"

#if HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3

HWY_BEFORE_NAMESPACE();
namespace voxelpipe::cpu {
namespace HWY_NAMESPACE {

static_assert(FragmentBatch::kPadding % kHalf == 0 && kBatchFragments % kHalf == 0);

// As many floats, and whole numbers, as a vector has doubles.
using DHF = hn::Rebind<float, DD>;
using DHI = hn::Rebind<int32_t, DD>;
using VHF = hn::Vec<DHF>;
using VHI = hn::Vec<DHI>;
using VL = hn::Vec<DL>;
using MD = hn::Mask<DD>;

struct Vec3D {
  VD x, y, z;
};

// Min, Max and Abs of base/vec.h, also for -0 and NaN.
HWY_INLINE VD MinD(VD a, VD b) {
  return hn::IfThenElse(hn::Lt(b, a), b, a);
}
HWY_INLINE VD MaxD(VD a, VD b) {
  return hn::IfThenElse(hn::Lt(a, b), b, a);
}
HWY_INLINE VD MaxAbsD(const Vec3D& v) {
  return MaxD(hn::Abs(v.x), MaxD(hn::Abs(v.y), hn::Abs(v.z)));
}
HWY_INLINE Vec3D operator+(const Vec3D& a, const Vec3D& b) {
  return {hn::Add(a.x, b.x), hn::Add(a.y, b.y), hn::Add(a.z, b.z)};
}
HWY_INLINE Vec3D operator-(const Vec3D& a, const Vec3D& b) {
  return {hn::Sub(a.x, b.x), hn::Sub(a.y, b.y), hn::Sub(a.z, b.z)};
}
HWY_INLINE Vec3D operator*(const Vec3D& a, VD s) {
  return {hn::Mul(a.x, s), hn::Mul(a.y, s), hn::Mul(a.z, s)};
}
HWY_INLINE VD Dot3(const Vec3D& a, const Vec3D& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}
HWY_INLINE Vec3D Cross3(const Vec3D& a, const Vec3D& b) {
  return {hn::Sub(hn::Mul(a.y, b.z), hn::Mul(a.z, b.y)), hn::Sub(hn::Mul(a.z, b.x), hn::Mul(a.x, b.z)),
          hn::Sub(hn::Mul(a.x, b.y), hn::Mul(a.y, b.x))};
}
// DifferenceOfProducts of raster/exact_math.h.
HWY_INLINE VD ProductDifference(VD a, VD b, VD c, VD d) {
  const VD cd = hn::Mul(c, d);
  const VD error = hn::NegMulAdd(c, d, cd);
  return hn::Add(hn::MulSub(a, b, cd), error);
}
HWY_INLINE Vec3D AccurateCross3(const Vec3D& a, const Vec3D& b) {
  return {ProductDifference(a.y, b.z, a.z, b.y), ProductDifference(a.z, b.x, a.x, b.z),
          ProductDifference(a.x, b.y, a.y, b.x)};
}

// Three doubles of each index.
HWY_INLINE Vec3D GatherVec3d(const Vec3d* array, VHI index) {
  const DL dl;
  const auto base = reinterpret_cast<const double*>(array);
  const VL i = hn::PromoteTo(dl, index);
  const VL at = hn::Add(hn::Add(i, i), i);
  return {hn::GatherIndex(DD(), base, at), hn::GatherIndex(DD(), base, hn::Add(at, hn::Set(dl, 1))),
          hn::GatherIndex(DD(), base, hn::Add(at, hn::Set(dl, 2)))};
}

// The planes of a batch's triangles, as Barycentrics reads them.
struct Planes {
  HWY_ALIGN double base[3][kBatchFragments], v0[3][kBatchFragments];
  HWY_ALIGN double f1[3][kBatchFragments], f2[3][kBatchFragments];  // scaled edges
  HWY_ALIGN double normal[3][kBatchFragments];
  HWY_ALIGN double scale[kBatchFragments], square[kBatchFragments];  // square: of the normal's length
};

HWY_INLINE void StoreVec3D(const Vec3D& v, double (*to)[kBatchFragments], int at) {
  const DD d;
  hn::Store(v.x, d, to[0] + at);
  hn::Store(v.y, d, to[1] + at);
  hn::Store(v.z, d, to[2] + at);
}
HWY_INLINE Vec3D GatherOf(const double (*from)[kBatchFragments], VL at) {
  const DD d;
  return {hn::GatherIndex(d, from[0], at), hn::GatherIndex(d, from[1], at), hn::GatherIndex(d, from[2], at)};
}

// SetUpPlane of the triangles.
HWY_INLINE void SetUpPlanes(FragmentBatch& batch, Planes& planes) {
  const DD d;
  const DHI di;
  for (int t = 0; t < batch.triangles; t += kHalf) {
    const Vec3D a = GatherVec3d(batch.mesh->index_positions, hn::Load(di, batch.vertex[0] + t));
    const Vec3D b = GatherVec3d(batch.mesh->index_positions, hn::Load(di, batch.vertex[1] + t));
    const Vec3D c = GatherVec3d(batch.mesh->index_positions, hn::Load(di, batch.vertex[2] + t));
    const Vec3D base{hn::Floor(MinD(a.x, MinD(b.x, c.x))), hn::Floor(MinD(a.y, MinD(b.y, c.y))),
                     hn::Floor(MinD(a.z, MinD(b.z, c.z)))};
    Vec3D e1 = b - a, e2 = c - a;
    const VD longest = MaxD(MaxAbsD(e1), MaxAbsD(e2));
    const MD point = hn::Lt(longest, hn::Set(d, 0x1p-900));
    const DU du;
    const auto exponent = hn::Add(hn::ShiftRight<52>(hn::BitCast(du, longest)), hn::Set(du, 1));
    const VD one = hn::Set(d, 1.0);
    const VD power = hn::IfThenElse(point, one, hn::BitCast(d, hn::ShiftLeft<52>(exponent)));
    const VD magic = hn::Mul(hn::Set(d, 3.0), power);
    const auto rounded = [&](VD v) HWY_ATTR { return hn::IfThenZeroElse(point, hn::Sub(hn::Add(v, magic), magic)); };
    e1 = {rounded(e1.x), rounded(e1.y), rounded(e1.z)};
    e2 = {rounded(e2.x), rounded(e2.y), rounded(e2.z)};
    const VD scale = hn::Div(one, power);
    const Vec3D f1 = e1 * scale, f2 = e2 * scale, f3 = f2 - f1;
    const Vec3D normal = AccurateCross3(f1, f2);
    const VD squares = MaxD(Dot3(f1, f1), MaxD(Dot3(f2, f2), Dot3(f3, f3)));
    const MD degenerate = hn::Le(MaxAbsD(normal), hn::Mul(hn::Set(d, kDegenerateRatio), squares));
    const hn::RebindToUnsigned<DHI> dhu;
    hn::Store(hn::TruncateTo(dhu, hn::BitCast(du, hn::VecFromMask(d, degenerate))), dhu, batch.degenerate + t);
    StoreVec3D(base, planes.base, t);
    StoreVec3D(a - base, planes.v0, t);
    StoreVec3D(f1, planes.f1, t);
    StoreVec3D(f2, planes.f2, t);
    StoreVec3D(normal, planes.normal, t);
    hn::Store(scale, d, planes.scale + t);
    hn::Store(Dot3(normal, normal), d, planes.square + t);
  }
}

HWY_ATTR void PlaceBatch(FragmentBatch& batch) {
  const DD d;
  const DHF df;
  const DHI di;
  Planes planes;
  SetUpPlanes(batch, planes);
  const VD half = hn::Set(d, 0.5), one = hn::Set(d, 1.0), zero = hn::Zero(d);
  const VHF third = hn::Set(df, 1.0f / 3.0f);
  for (int i = 0; i < batch.count; i += kHalf) {
    const VHI triangle = hn::Load(di, batch.triangle_of + i);
    const VL at = hn::PromoteTo(DL(), triangle);
    const Vec3D base = GatherOf(planes.base, at);
    const Vec3D voxel{hn::PromoteTo(d, hn::Load(di, batch.voxel[0] + i)),
                      hn::PromoteTo(d, hn::Load(di, batch.voxel[1] + i)),
                      hn::PromoteTo(d, hn::Load(di, batch.voxel[2] + i))};
    const Vec3D corner = voxel - base;
    const Vec3D centre{hn::Add(corner.x, half), hn::Add(corner.y, half), hn::Add(corner.z, half)};
    const Vec3D v = (centre - GatherOf(planes.v0, at)) * hn::GatherIndex(d, planes.scale, at);
    const Vec3D f1 = GatherOf(planes.f1, at), f2 = GatherOf(planes.f2, at), normal = GatherOf(planes.normal, at);
    const VD square = hn::GatherIndex(d, planes.square, at);
    VD b1 = hn::Div(Dot3(Cross3(v, f2), normal), square);
    VD b2 = hn::Div(Dot3(Cross3(f1, v), normal), square);
    VD b0 = hn::Sub(hn::Sub(one, b1), b2);
    b0 = MaxD(b0, zero);
    b1 = MaxD(b1, zero);
    b2 = MaxD(b2, zero);
    const VD sum = hn::Add(hn::Add(b0, b1), b2);
    const VHI bits = hn::GatherIndex(di, reinterpret_cast<const int32_t*>(batch.degenerate), triangle);
    const auto degenerate = hn::RebindMask(df, hn::MaskFromVec(bits));
    const VD b[3] = {b0, b1, b2};
    for (int k = 0; k < 3; ++k) {
      const VHF weight = hn::DemoteTo(df, hn::Div(b[k], sum));
      hn::Store(hn::IfThenElse(degenerate, third, weight), df, batch.barycentric[k] + i);
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace voxelpipe::cpu
HWY_AFTER_NAMESPACE();

#endif  // HWY_TARGET
#endif  // include guard
