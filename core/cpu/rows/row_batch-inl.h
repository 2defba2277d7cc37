// Small triangles, several per vector: the operations of raster/triangle_setup.h and raster/spans.h, lane by lane in
// the same order. Included once for each instruction set; no include guard but Highway's.
#if defined(VOXELPIPE_ROW_BATCH_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef VOXELPIPE_ROW_BATCH_INL_H_
#undef VOXELPIPE_ROW_BATCH_INL_H_
#else
#define VOXELPIPE_ROW_BATCH_INL_H_
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <bit>

#include "cpu/rows/row_kernels.h"
#include "cpu/rows/row_lanes-inl.h"
#include "cpu/rows/row_scan-inl.h"
#include "grid/index_space.h"

#if HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3

HWY_BEFORE_NAMESPACE();
namespace voxelpipe::cpu {
namespace HWY_NAMESPACE {

// ---- several small triangles per vector ----

struct WideVector {  // kLanes doubles
  VD lo, hi;
};
HWY_INLINE WideVector Sub(const WideVector& a, const WideVector& b) {
  return {hn::Sub(a.lo, b.lo), hn::Sub(a.hi, b.hi)};
}
HWY_INLINE WideVector Min3(const WideVector& a, const WideVector& b, const WideVector& c) {
  return {hn::Min(a.lo, hn::Min(b.lo, c.lo)), hn::Min(a.hi, hn::Min(b.hi, c.hi))};
}
HWY_INLINE WideVector Max3(const WideVector& a, const WideVector& b, const WideVector& c) {
  return {hn::Max(a.lo, hn::Max(b.lo, c.lo)), hn::Max(a.hi, hn::Max(b.hi, c.hi))};
}
HWY_INLINE VF ToFloat(const WideVector& v) {
  const hn::Half<DF> dh;
  return hn::Combine(DF(), hn::DemoteTo(dh, v.hi), hn::DemoteTo(dh, v.lo));
}
HWY_INLINE VI ToInt(const WideVector& v) {
  const hn::Half<DI> dh;
  return hn::Combine(DI(), hn::DemoteTo(dh, v.hi), hn::DemoteTo(dh, v.lo));
}
HWY_INLINE WideVector ToDouble(VF v) {
  return {hn::PromoteTo(DD(), hn::LowerHalf(hn::Half<DF>(), v)), hn::PromoteTo(DD(), hn::UpperHalf(hn::Half<DF>(), v))};
}

struct VecF {
  VF x, y, z;
};
HWY_INLINE VF Dot(const VecF& a, const VecF& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}
// DifferenceOfProducts of exact_math.h.
HWY_INLINE VF DiffProducts(VF a, VF b, VF c, VF d) {
  const VF cd = hn::Mul(c, d);
  const VF error = hn::NegMulAdd(c, d, cd);
  return hn::Add(hn::MulSub(a, b, cd), error);
}
HWY_INLINE VF MaxAbsF(const VecF& v) {
  return hn::Max(hn::Abs(v.x), hn::Max(hn::Abs(v.y), hn::Abs(v.z)));
}

struct BoundF {
  VF s, lo, hi;
};

// The result of BoundShape, for kLanes triangles.
struct BoundsF {
  VecF first, last;
  BoundF y_of_z[4], x_of_z[3], x_of_y[3], plane;
  VF plane_sy;
};

struct ShapeF {
  VecF v0, v1, f1, f2, f3, normal, half;
  VF extent;
};

HWY_INLINE BoundF SolveF(MF bounded, VF inverse, VF nt, VF lo, VF hi) {
  const VF a = hn::Mul(lo, inverse), b = hn::Mul(hi, inverse);
  return {hn::IfThenElseZero(bounded, hn::Mul(nt, inverse)), hn::IfThenElse(bounded, hn::Min(a, b), SetF(-1e30f)),
          hn::IfThenElse(bounded, hn::Max(a, b), SetF(1e30f))};
}

// `inverse` is 1 / nu; au and at are |nu| and |nt|; half_u and half_t include the widening.
HWY_INLINE BoundF EdgeBoundF(VF nu, VF nt, VF inverse, VF au, VF at, VF pu, VF pt, VF opposite, VF half_u, VF half_t,
                             VF far) {
  const MF bounded = hn::Gt(hn::Mul(au, far), hn::Mul(hn::Add(au, at), SetF(0x1p-20f)));
  const VF edge = hn::Add(hn::Mul(nu, pu), hn::Mul(nt, pt));
  const VF other = hn::Add(edge, opposite);
  const VF reach = hn::Add(hn::Mul(au, half_u), hn::Mul(at, half_t));
  const VF centre = hn::Mul(SetF(0.5f), hn::Add(nu, nt));
  return SolveF(bounded, inverse, nt, hn::Sub(hn::Sub(hn::Min(edge, other), reach), centre),
                hn::Sub(hn::Add(hn::Max(edge, other), reach), centre));
}

HWY_INLINE void BoundEdgeF(const ShapeF& s, int i, const VecF& f, const VecF& p, bool third_below, BoundsF& out) {
  const auto side = [&](VF n) HWY_ATTR { return third_below ? hn::Neg(n) : n; };
  const VF ax = hn::Abs(f.x), ay = hn::Abs(f.y), az = hn::Abs(f.z);
  const VF by_y = hn::Div(SetF(1), f.y), by_z = hn::Div(SetF(1), f.z);
  const VF far = hn::Add(s.extent, SetF(2)), widening = SetF(float(kNarrowWidening));
  const VecF half{hn::Add(s.half.x, widening), hn::Add(s.half.y, widening), hn::Add(s.half.z, widening)};
  out.y_of_z[i] = EdgeBoundF(f.z, hn::Neg(f.y), by_z, az, ay, p.y, p.z, side(s.normal.x), half.y, half.z, far);
  out.x_of_z[i] = EdgeBoundF(hn::Neg(f.z), f.x, hn::Neg(by_z), az, ax, p.x, p.z, side(s.normal.y), half.x, half.z, far);
  out.x_of_y[i] = EdgeBoundF(f.y, hn::Neg(f.x), by_y, ay, ax, p.x, p.y, side(s.normal.z), half.x, half.y, far);
}

template <Coverage kCoverage>
HWY_INLINE void BoundPlaneF(const ShapeF& s, BoundsF& out) {
  const VF widening = SetF(float(kNarrowWidening));
  const VecF& n = s.normal;
  const VF ax = hn::Abs(n.x), ay = hn::Abs(n.y), az = hn::Abs(n.z);
  const VF norm = hn::Add(hn::Add(ax, ay), az);
  VF reach = hn::Add(hn::Add(hn::Mul(ax, hn::Add(s.half.x, widening)), hn::Mul(ay, hn::Add(s.half.y, widening))),
                     hn::Mul(az, hn::Add(s.half.z, widening)));
  if (kCoverage == Coverage::kThin) {
    reach = hn::Add(hn::Mul(SetF(0.5f), hn::Max(ax, hn::Max(ay, az))), hn::Mul(widening, norm));
  }
  const VF at = hn::Add(hn::Add(hn::Mul(n.x, s.v0.x), hn::Mul(n.y, s.v0.y)), hn::Mul(n.z, s.v0.z));
  const VF centre = hn::Mul(SetF(0.5f), hn::Add(hn::Add(n.x, n.y), n.z));
  const VF lo = hn::Sub(hn::Sub(at, reach), centre), hi = hn::Sub(hn::Add(at, reach), centre);
  const VF far = hn::Add(s.extent, SetF(2)), parallel = hn::Mul(norm, SetF(0x1p-20f));
  const MF by_x = hn::Gt(hn::Mul(ax, far), parallel);
  const MF by_y = hn::AndNot(by_x, hn::Gt(hn::Mul(ay, far), parallel));
  const VF inverse = hn::Div(SetF(1), n.x);
  out.plane = SolveF(by_x, inverse, n.z, lo, hi);
  out.plane_sy = hn::IfThenElseZero(by_x, hn::Mul(n.y, inverse));
  out.y_of_z[3] = SolveF(by_y, hn::Div(SetF(1), n.y), n.z, lo, hi);
}

struct Batch {
  BoundsF bounds;
  MF narrow;             // the lanes that are set up
  VI base[3];            // the first voxel of the triangle's box, grid coordinates
  VI first[3], last[3];  // the box, grid coordinates
};

// WorldToIndex of one coordinate of kLanes vertices.
HWY_INLINE WideVector ToIndexSpace(const RowMesh& mesh, bool walls, VD lo, VD hi, int axis, const Divisor& divisor) {
  const VD origin = SetD(mesh.space.origin[axis]);
  VD a = hn::Sub(lo, origin), b = hn::Sub(hi, origin);
  if (HWY_LIKELY(mesh.regular)) {
    a = QuotientOfRegular(a, divisor);
    b = QuotientOfRegular(b, divisor);
  } else {
    a = hn::Div(a, SetD(divisor.h));
    b = hn::Div(b, SetD(divisor.h));
  }
  if (HWY_LIKELY(!walls)) return {a, b};
  return {ToWallD(mesh.space, axis, a), ToWallD(mesh.space, axis, b)};
}

// SetUpTriangle for kLanes triangles, those that are not SpanClass::kRun.
template <Coverage kCoverage>
HWY_INLINE void SetUpBatch(const RowMesh& mesh, const Divisor (&divisors)[3], const uint32_t* ids, Batch& out) {
  const DU du;
  const DL dl;
  const hn::Rebind<uint32_t, DU> d32;
  const double* positions = &mesh.positions[0].x;
  hn::Vec<DL> at[2][3];  // half, vertex: its x among the positions
  for (int half = 0; half < 2; ++half) {
    // A triangle's ids as two overlapping pairs.
    const auto pairs = reinterpret_cast<const uint64_t*>(mesh.triangles);
    const auto id = hn::PromoteTo(du, hn::LoadU(d32, ids + half * kHalf));
    const auto offset = hn::BitCast(dl, hn::Add(hn::ShiftLeft<3>(id), hn::ShiftLeft<2>(id)));
    const auto first = hn::GatherOffset(du, pairs, offset);
    const auto second = hn::GatherOffset(du, pairs, hn::Add(offset, hn::Set(dl, int64_t{4})));
    const hn::Vec<DU> v[3] = {hn::And(first, hn::Set(du, uint64_t{0xffffffff})), hn::ShiftRight<32>(first),
                              hn::ShiftRight<32>(second)};
    for (int i = 0; i < 3; ++i) at[half][i] = hn::BitCast(dl, hn::Add(v[i], hn::ShiftLeft<1>(v[i])));
  }
  const bool walls = mesh.space.has_walls();
  WideVector p[3][3];  // vertex, axis
  for (int i = 0; i < 3; ++i) {
    for (int a = 0; a < 3; ++a) {
      p[i][a] = ToIndexSpace(mesh, walls, hn::GatherIndex(DD(), positions + a, at[0][i]),
                             hn::GatherIndex(DD(), positions + a, at[1][i]), a, divisors[a]);
    }
  }
  WideVector least[3], most[3], base[3], e1[3], e2[3];
  VD longest_lo = SetD(0), longest_hi = SetD(0);
  for (int a = 0; a < 3; ++a) {
    least[a] = Min3(p[0][a], p[1][a], p[2][a]);
    most[a] = Max3(p[0][a], p[1][a], p[2][a]);
    base[a] = {hn::Floor(least[a].lo), hn::Floor(least[a].hi)};
    e1[a] = Sub(p[1][a], p[0][a]);
    e2[a] = Sub(p[2][a], p[0][a]);
    longest_lo = hn::Max(longest_lo, hn::Max(hn::Abs(e1[a].lo), hn::Abs(e2[a].lo)));
    longest_hi = hn::Max(longest_hi, hn::Max(hn::Abs(e1[a].hi), hn::Abs(e2[a].hi)));
  }
  const auto magic = [](VD longest) HWY_ATTR {  // PowerOfTwoAbove(longest) * 0x1.8p29
    const auto bits = hn::ShiftRight<52>(hn::BitCast(DU(), longest));
    return hn::Mul(hn::BitCast(DD(), hn::ShiftLeft<52>(hn::Add(bits, hn::Set(DU(), uint64_t{1})))), SetD(0x1.8p29));
  };
  const VD magic_lo = magic(longest_lo), magic_hi = magic(longest_hi);
  const auto quantized = [&](const WideVector& e) HWY_ATTR {
    return ToFloat({hn::Sub(hn::Add(e.lo, magic_lo), magic_lo), hn::Sub(hn::Add(e.hi, magic_hi), magic_hi)});
  };
  const auto fits = [](VD longest) HWY_ATTR {
    return hn::IfThenElseZero(hn::And(hn::Ge(longest, SetD(kMinNarrow)), hn::Le(longest, SetD(kMaxNarrow))), SetD(1));
  };
  ShapeF s;
  s.f1 = {quantized(e1[0]), quantized(e1[1]), quantized(e1[2])};
  s.f2 = {quantized(e2[0]), quantized(e2[1]), quantized(e2[2])};
  s.f3 = {hn::Sub(s.f2.x, s.f1.x), hn::Sub(s.f2.y, s.f1.y), hn::Sub(s.f2.z, s.f1.z)};
  s.normal = {DiffProducts(s.f1.y, s.f2.z, s.f1.z, s.f2.y), DiffProducts(s.f1.z, s.f2.x, s.f1.x, s.f2.z),
              DiffProducts(s.f1.x, s.f2.y, s.f1.y, s.f2.x)};
  const VF longest_squared = hn::Max(Dot(s.f1, s.f1), hn::Max(Dot(s.f2, s.f2), Dot(s.f3, s.f3)));
  out.narrow = hn::And(hn::Gt(ToFloat({fits(longest_lo), fits(longest_hi)}), SetF(0.5f)),
                       hn::Ge(MaxAbsF(s.normal), hn::Mul(SetF(kNarrowRatio), longest_squared)));
  s.v0 = {ToFloat(Sub(p[0][0], base[0])), ToFloat(Sub(p[0][1], base[1])), ToFloat(Sub(p[0][2], base[2]))};
  s.v1 = {hn::Add(s.v0.x, s.f1.x), hn::Add(s.v0.y, s.f1.y), hn::Add(s.v0.z, s.f1.z)};
  s.extent = hn::Max(MaxAbsF(s.f1), MaxAbsF(s.f2));
  VF half[3] = {SetF(0.5f), SetF(0.5f), SetF(0.5f)};
  if (kCoverage == Coverage::kCenter) {
    const VF ax = hn::Abs(s.normal.x), ay = hn::Abs(s.normal.y), az = hn::Abs(s.normal.z);
    const MF is_x = hn::And(hn::Ge(ax, ay), hn::Ge(ax, az)), is_y = hn::AndNot(is_x, hn::Ge(ay, az));
    half[0] = hn::IfThenElseZero(is_x, SetF(0.5f));
    half[1] = hn::IfThenElseZero(is_y, SetF(0.5f));
    half[2] = hn::IfThenZeroElse(hn::Or(is_x, is_y), SetF(0.5f));
  }
  s.half = {half[0], half[1], half[2]};
  VF* const firsts[3] = {&out.bounds.first.x, &out.bounds.first.y, &out.bounds.first.z};
  VF* const lasts[3] = {&out.bounds.last.x, &out.bounds.last.y, &out.bounds.last.z};
  for (int a = 0; a < 3; ++a) {
    const WideVector h = ToDouble(half[a]);
    const auto first = [&](VD lo, VD ha) HWY_ATTR {
      return hn::Ceil(hn::Sub(lo, hn::Add(hn::Add(SetD(0.5), ha), SetD(kNarrowWidening))));
    };
    const auto last = [&](VD hi, VD ha) HWY_ATTR {
      return hn::Floor(hn::Sub(hi, hn::Sub(hn::Sub(SetD(0.5), ha), SetD(kNarrowWidening))));
    };
    const WideVector box_first{first(least[a].lo, h.lo), first(least[a].hi, h.hi)};
    const WideVector box_last{last(most[a].lo, h.lo), last(most[a].hi, h.hi)};
    *firsts[a] = ToFloat(Sub(box_first, base[a]));
    *lasts[a] = ToFloat(Sub(box_last, base[a]));
    out.base[a] = ToInt(base[a]);
    out.first[a] = ToInt(box_first);
    out.last[a] = ToInt(box_last);
  }
  BoundEdgeF(s, 0, s.f1, s.v0, true, out.bounds);
  BoundEdgeF(s, 1, s.f3, s.v1, true, out.bounds);
  BoundEdgeF(s, 2, s.f2, s.v0, false, out.bounds);
  BoundPlaneF<kCoverage>(s, out.bounds);
}

HWY_INLINE hn::Mask<DI> AtMost(VI a, VI b) {
  return hn::Not(hn::Gt(a, b));
}

// The maximum of `least` and the lanes of v where `m` is set.
HWY_INLINE int32_t MaxWhere(MF m, VI v, int32_t least) {
  const DI di;
  return hn::GetLane(hn::MaxOfLanes(di, hn::IfThenElse(hn::RebindMask(di, m), v, hn::Set(di, least))));
}

HWY_INLINE void Tighten(const BoundF& b, VF t, VF& first, VF& last) {
  const VF shift = hn::Mul(b.s, t);
  first = hn::Max(first, hn::Sub(b.lo, shift));
  last = hn::Min(last, hn::Sub(b.hi, shift));
}

// Rounds a local interval to whole voxels within one of its box, and moves it to grid coordinates.
HWY_INLINE void ToGrid(VF first, VF last, VF box_first, VF box_last, VI base, VI& begin, VI& end) {
  const DI di;
  const VF f = hn::Min(hn::Ceil(first), hn::Add(box_last, SetF(1)));
  const VF l = hn::Max(hn::Floor(last), hn::Sub(box_first, SetF(1)));
  begin = hn::Add(base, hn::ConvertTo(di, f));
  end = hn::Add(base, hn::ConvertTo(di, l));
}

HWY_INLINE VI Shifted(VI v, VI by) {
  const hn::RebindToUnsigned<DI> du;
  return hn::BitCast(DI(), hn::Shl(hn::BitCast(du, v), hn::BitCast(du, by)));
}

// A dense list of bits to set, filled before their words are read: testing words one by one would mispredict branches.
struct WordList {
  static constexpr int64_t kMaxWords = 512;
  int64_t count = 0;
  HWY_ALIGN int32_t word[kMaxWords + kLanes];
  HWY_ALIGN int32_t bits[kMaxWords + kLanes];
};

HWY_INLINE void Append(hn::Mask<DI> lanes, VI word, VI bits, WordList& list) {
  const DI di;
  hn::StoreU(hn::Compress(word, lanes), di, list.word + list.count);
  hn::StoreU(hn::Compress(bits, lanes), di, list.bits + list.count);
  list.count += int64_t(hn::CountTrue(di, lanes));
}

HWY_INLINE void Flush(const RowSlab& slab, WordList& list) {
  const DI di;
  const auto words = reinterpret_cast<const int32_t*>(slab.words);
  hn::StoreU(hn::Zero(di), di, list.word + list.count);  // the unused lanes of the last vector
  hn::StoreU(hn::Zero(di), di, list.bits + list.count);
  for (int64_t i = 0; i < list.count; i += kLanes) {
    const VI held = hn::GatherIndex(di, words, hn::Load(di, list.word + i));
    uint64_t lanes = Bits(di, hn::Ne(hn::AndNot(held, hn::Load(di, list.bits + i)), hn::Zero(di)));
    for (; lanes != 0; lanes &= lanes - 1) {
      const int64_t k = i + std::countr_zero(lanes);
      OrWord(slab.words[list.word[k]], uint32_t(list.bits[k]), slab.shared);
    }
  }
  list.count = 0;
}

HWY_INLINE void RasterBatch(const Batch& batch, const RowSlab& slab, WordList& list) {
  const DF df;
  const DI di;
  const BoundsF& b = batch.bounds;
  const VI z_first = hn::Max(batch.first[2], SetI(slab.begin)), z_last = hn::Min(batch.last[2], SetI(slab.end - 1));
  const int32_t layers = MaxWhere(batch.narrow, hn::Sub(z_last, z_first), -1);
  HWY_ALIGN int32_t row_out[kLanes], begin_out[kLanes], end_out[kLanes];
  const VI words_per_row = SetI(slab.words_per_row), one = SetI(1), low5 = SetI(31);
  for (int32_t k = 0; k <= layers; ++k) {
    const VI z = hn::Add(z_first, SetI(k));
    const VF z_local = hn::ConvertTo(df, hn::Sub(z, batch.base[2]));
    VF y_first = b.first.y, y_last = b.last.y, x_first = b.first.x, x_last = b.last.x;
    for (int i = 0; i < 4; ++i) Tighten(b.y_of_z[i], z_local, y_first, y_last);
    for (int i = 0; i < 3; ++i) Tighten(b.x_of_z[i], z_local, x_first, x_last);
    const VF plane_shift = hn::Mul(b.plane.s, z_local);
    const VF plane_lo = hn::Sub(b.plane.lo, plane_shift), plane_hi = hn::Sub(b.plane.hi, plane_shift);
    VI y_begin, y_end;
    ToGrid(y_first, y_last, b.first.y, b.last.y, batch.base[1], y_begin, y_end);
    y_begin = hn::Max(y_begin, hn::Zero(di));
    y_end = hn::Min(y_end, SetI(slab.ny - 1));
    const MF in_layer = hn::And(batch.narrow, hn::RebindMask(df, AtMost(z, z_last)));
    const int32_t rows = MaxWhere(in_layer, hn::Sub(y_end, y_begin), -1);
    const VI z_row = hn::Mul(hn::Sub(z, SetI(slab.begin)), SetI(slab.ny));
    VI row = hn::Mul(hn::Add(y_begin, z_row), words_per_row);
    for (int32_t j = 0; j <= rows; ++j, row = hn::Add(row, words_per_row)) {
      const VI y = hn::Add(y_begin, SetI(j));
      const VF y_local = hn::ConvertTo(df, hn::Sub(y, batch.base[1]));
      VF first = x_first, last = x_last;
      for (int i = 0; i < 3; ++i) Tighten(b.x_of_y[i], y_local, first, last);
      const VF shift = hn::Mul(b.plane_sy, y_local);
      first = hn::Max(first, hn::Sub(plane_lo, shift));
      last = hn::Min(last, hn::Sub(plane_hi, shift));
      VI x_begin, x_end;
      ToGrid(first, last, b.first.x, b.last.x, batch.base[0], x_begin, x_end);
      x_begin = hn::Max(x_begin, hn::Zero(di));
      x_end = hn::Min(x_end, SetI(slab.nx - 1));
      const auto hit = hn::And(hn::RebindMask(di, in_layer), hn::And(AtMost(y, y_end), AtMost(x_begin, x_end)));
      const VI word = hn::ShiftRight<5>(x_begin), last_word = hn::ShiftRight<5>(x_end);
      const VI head = hn::Sub(hn::Zero(di), Shifted(one, hn::And(x_begin, low5)));
      const VI tail = hn::Sub(Shifted(hn::Set(di, 2), hn::And(x_end, low5)), one);
      const auto one_word = hn::Eq(word, last_word);
      Append(hit, hn::Add(row, word), hn::And(head, hn::IfThenElse(one_word, tail, hn::Set(di, -1))), list);
      const auto several = hn::AndNot(one_word, hit);
      if (!hn::AllFalse(di, several)) {
        Append(several, hn::Add(row, last_word), tail, list);
        const auto many = hn::And(several, hn::Gt(last_word, hn::Add(word, one)));
        if (HWY_UNLIKELY(!hn::AllFalse(di, many))) {
          hn::Store(row, di, row_out);
          hn::Store(x_begin, di, begin_out);
          hn::Store(x_end, di, end_out);
          for (uint64_t lanes = Bits(di, many); lanes != 0; lanes &= lanes - 1) {
            const int lane = std::countr_zero(lanes);
            SetBits(slab.words + row_out[lane], begin_out[lane], int64_t{end_out[lane]} + 1, slab.shared);
          }
        }
      }
      if (HWY_UNLIKELY(list.count > WordList::kMaxWords - 2 * kLanes)) Flush(slab, list);
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace voxelpipe::cpu
HWY_AFTER_NAMESPACE();

#endif  // HWY_TARGET
#endif  // include guard
