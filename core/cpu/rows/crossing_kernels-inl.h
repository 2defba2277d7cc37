// The parity fill on vectors: the operations of raster/crossing.h and raster/triangle_plane.h, lane by lane in the same
// order. Included once for each instruction set, after row_kernels-inl.h; no include guard but Highway's.
#if defined(VOXELPIPE_CROSSING_KERNELS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef VOXELPIPE_CROSSING_KERNELS_INL_H_
#undef VOXELPIPE_CROSSING_KERNELS_INL_H_
#else
#define VOXELPIPE_CROSSING_KERNELS_INL_H_
#endif

#include "cpu/rows/crossings.h"
#include "cpu/rows/row_kernels-inl.h"

#if HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3

HWY_BEFORE_NAMESPACE();
namespace voxelpipe::cpu {
namespace HWY_NAMESPACE {

using MD = hn::Mask<DD>;
using VU = hn::Vec<DU>;

struct VecD {
  VD x, y, z;
};
HWY_INLINE VecD Sub(const VecD& a, const VecD& b) {
  return {hn::Sub(a.x, b.x), hn::Sub(a.y, b.y), hn::Sub(a.z, b.z)};
}
HWY_INLINE VecD Scale(const VecD& a, VD s) {
  return {hn::Mul(a.x, s), hn::Mul(a.y, s), hn::Mul(a.z, s)};
}
HWY_INLINE VD DotD(const VecD& a, const VecD& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}
HWY_INLINE VD MaxAbsD(const VecD& a) {
  return hn::Max(hn::Abs(a.x), hn::Max(hn::Abs(a.y), hn::Abs(a.z)));
}
HWY_INLINE VD Min3D(VD a, VD b, VD c) {
  return hn::Min(a, hn::Min(b, c));
}
HWY_INLINE VD Max3D(VD a, VD b, VD c) {
  return hn::Max(a, hn::Max(b, c));
}
// DifferenceOfProducts of exact_math.h.
HWY_INLINE VD DiffProductsD(VD a, VD b, VD c, VD d) {
  const VD cd = hn::Mul(c, d);
  const VD error = hn::NegMulAdd(c, d, cd);
  return hn::Add(hn::MulSub(a, b, cd), error);
}

// LinesOf, lane by lane. An empty range has its end at or below its begin.
struct LinesD {
  VD y_begin, y_end, z_begin, z_end;
};
HWY_INLINE LinesD LinesOfD(VD ay, VD by, VD cy, VD az, VD bz, VD cz, const LineBlocks& lines) {
  const auto clamped = [](VD v, double lo, double hi) HWY_ATTR { return hn::Min(hn::Max(v, SetD(lo)), SetD(hi)); };
  const double ny = double(lines.ny), z0 = double(lines.z_begin), z1 = double(lines.z_end);
  const VD half = SetD(0.5);
  return {clamped(hn::Ceil(hn::Sub(Min3D(ay, by, cy), half)), 0, ny),
          clamped(hn::Ceil(hn::Sub(Max3D(ay, by, cy), half)), 0, ny),
          clamped(hn::Ceil(hn::Sub(Min3D(az, bz, cz), SetD(0.5 + kLineSlack))), z0, z1),
          clamped(hn::Add(hn::Floor(hn::Sub(Max3D(az, bz, cz), SetD(0.5 - kLineSlack))), SetD(1)), z0, z1)};
}

// An edge with its ends in lexicographic (y, z) order.
struct EdgeD {
  VD py, pz, qy, dy, dz;
  MD falls;  // the edge falls in y where it is crossed
};
HWY_INLINE EdgeD OrderedEdge(const VecD& a, const VecD& b) {
  const MD a_first = hn::Or(hn::Lt(a.y, b.y), hn::And(hn::Eq(a.y, b.y), hn::Le(a.z, b.z)));
  const VD py = hn::IfThenElse(a_first, a.y, b.y), qy = hn::IfThenElse(a_first, b.y, a.y);
  const VD pz = hn::IfThenElse(a_first, a.z, b.z), qz = hn::IfThenElse(a_first, b.z, a.z);
  return {py, pz, qy, hn::Sub(qy, py), hn::Sub(qz, pz), hn::Not(a_first)};
}

// TrianglePlane, and the triangle's x range.
struct PlaneD {
  VecD base, v0, normal;
  VD lo, hi;
  MD regular;  // neither degenerate nor edge-on: CrossingX divides by normal.x
};
HWY_INLINE PlaneD SetUpPlaneD(const VecD& a, const VecD& b, const VecD& c) {
  const DU du;
  PlaneD s;
  s.lo = Min3D(a.x, b.x, c.x);
  s.hi = Max3D(a.x, b.x, c.x);
  s.base = {hn::Floor(s.lo), hn::Floor(Min3D(a.y, b.y, c.y)), hn::Floor(Min3D(a.z, b.z, c.z))};
  s.v0 = Sub(a, s.base);
  VecD e1 = Sub(b, a), e2 = Sub(c, a);
  const VD longest = hn::Max(MaxAbsD(e1), MaxAbsD(e2));
  const VU exponent = hn::Add(hn::ShiftRight<52>(hn::BitCast(du, longest)), hn::Set(du, uint64_t{1}));
  const VD magic = hn::Mul(SetD(3), hn::BitCast(DD(), hn::ShiftLeft<52>(exponent)));
  const VD scale = hn::BitCast(DD(), hn::ShiftLeft<52>(hn::Sub(hn::Set(du, uint64_t{2046}), exponent)));
  const auto rounded = [&](const VecD& e) HWY_ATTR {
    return VecD{hn::Sub(hn::Add(e.x, magic), magic), hn::Sub(hn::Add(e.y, magic), magic),
                hn::Sub(hn::Add(e.z, magic), magic)};
  };
  const VecD f1 = Scale(rounded(e1), scale), f2 = Scale(rounded(e2), scale), f3 = Sub(f2, f1);
  s.normal = {DiffProductsD(f1.y, f2.z, f1.z, f2.y), DiffProductsD(f1.z, f2.x, f1.x, f2.z),
              DiffProductsD(f1.x, f2.y, f1.y, f2.x)};
  const VD widest = hn::Max(DotD(f1, f1), hn::Max(DotD(f2, f2), DotD(f3, f3)));
  s.regular = hn::And(hn::Gt(MaxAbsD(s.normal), hn::Mul(SetD(kDegenerateRatio), widest)),
                      hn::And(hn::Ne(s.normal.x, hn::Zero(DD())), hn::Ge(longest, SetD(0x1p-900))));
  return s;
}

// CentresBefore of CrossingX, in voxels; ny_dy is normal.y * dy.
HWY_INLINE VD BeforeD(const PlaneD& s, VD ny_dy, VD pz, double nx) {
  const VD dz = hn::Sub(hn::Sub(pz, s.base.z), s.v0.z);
  const VD x = hn::Sub(s.v0.x, hn::Div(hn::Add(ny_dy, hn::Mul(s.normal.z, dz)), s.normal.x));
  const VD clamped = hn::Min(hn::Max(hn::Add(s.base.x, x), s.lo), s.hi);
  return hn::Min(hn::Max(hn::Ceil(hn::Sub(clamped, SetD(0.5))), SetD(0)), SetD(nx));
}

// The integer of a double in [0, 2^52).
HWY_INLINE VU ToUnsigned(VD v) {
  return hn::And(hn::BitCast(DU(), hn::Add(v, SetD(0x1p52))), hn::Set(DU(), (uint64_t{1} << 52) - 1));
}

// kHalf triangles of few lines: the indices of their vertices, the lanes in use.
HWY_INLINE void CrossBatch(const RowMesh& mesh, const uint64_t* v01, const uint64_t* v2, uint64_t used,
                           const LineBlocks& lines, Crossings& out) {
  const DD d;
  const DU du;
  const DL dl;
  const double* positions = &mesh.positions[0].x;
  const VU first = hn::Load(du, v01), low32 = hn::Set(du, uint64_t{0xffffffff});
  const VU v[3] = {hn::And(first, low32), hn::ShiftRight<32>(first), hn::Load(du, v2)};
  VecD p[3];
  for (int i = 0; i < 3; ++i) {
    const auto at = hn::BitCast(dl, hn::Add(v[i], hn::ShiftLeft<1>(v[i])));
    p[i] = {hn::GatherIndex(d, positions, at), hn::GatherIndex(d, positions + 1, at),
            hn::GatherIndex(d, positions + 2, at)};
  }
  const LinesD range = LinesOfD(p[0].y, p[1].y, p[2].y, p[0].z, p[1].z, p[2].z, lines);
  const PlaneD plane = SetUpPlaneD(p[0], p[1], p[2]);
  const EdgeD edges[3] = {OrderedEdge(p[0], p[1]), OrderedEdge(p[1], p[2]), OrderedEdge(p[2], p[0])};
  const MD regular = hn::And(plane.regular, hn::FirstN(d, size_t(std::popcount(used))));
  const VD rows = hn::Sub(range.y_end, range.y_begin), layers = hn::Sub(range.z_end, range.z_begin);
  const int most_rows = int(hn::GetLane(hn::MaxOfLanes(d, hn::IfThenElseZero(regular, rows))));
  const int most_layers = int(hn::GetLane(hn::MaxOfLanes(d, hn::IfThenElseZero(regular, layers))));
  const VD half = SetD(0.5);
  const VU in_block = hn::Set(du, (uint64_t{1} << lines.block_shift) - 1), one = hn::Set(du, uint64_t{1});
  const hn::Repartition<uint32_t, DU> du32;
  const auto row_bits = hn::BitCast(du32, hn::Set(du, uint64_t(lines.row_bits)));
  for (int j = 0; j < most_rows; ++j) {
    const VD y = hn::Add(range.y_begin, SetD(j)), py = hn::Add(y, half);
    const MD in_row = hn::And(regular, hn::Lt(y, range.y_end));
    MD straddles[3];
    VD run[3];
    for (int e = 0; e < 3; ++e) {
      straddles[e] = hn::AndNot(hn::Le(edges[e].qy, py), hn::Le(edges[e].py, py));  // py <= qy
      run[e] = hn::Mul(edges[e].dz, hn::Sub(py, edges[e].py));
    }
    const VD ny_dy = hn::Mul(plane.normal.y, hn::Sub(hn::Sub(py, plane.base.y), plane.v0.y));
    for (int k = 0; k < most_layers; ++k) {
      const VD z = hn::Add(range.z_begin, SetD(k)), pz = hn::Add(z, half);
      MD above[3];
      for (int e = 0; e < 3; ++e) {
        const VD side = hn::Sub(hn::Mul(edges[e].dy, hn::Sub(pz, edges[e].pz)), run[e]);
        above[e] = hn::And(straddles[e], hn::Lt(side, hn::Zero(d)));
      }
      const MD crossed =
          hn::And(hn::And(in_row, hn::Lt(z, range.z_end)), hn::Xor(hn::Xor(above[0], above[1]), above[2]));
      const uint64_t lanes = Bits(d, crossed);
      if (lanes == 0) continue;
      const VU before = ToUnsigned(BeforeD(plane, ny_dy, pz, double(lines.nx)));
      const VU row = ToUnsigned(hn::Add(hn::Mul(hn::Sub(z, SetD(double(lines.z_begin))), SetD(double(lines.ny))), y));
      const VU local = hn::And(row, in_block);
      VU block = hn::ShiftLeft<1>(hn::ShiftRightSame(row, lines.block_shift));
      if (lines.with_signs) {
        const MD falls = hn::Or(hn::And(above[0], edges[0].falls),
                                hn::Or(hn::And(above[1], edges[1].falls), hn::And(above[2], edges[2].falls)));
        const VU two = hn::Set(du, uint64_t{2});
        block = hn::Add(hn::ShiftLeft<1>(block), hn::IfThenElseZero(hn::RebindMask(du, falls), two));
      }
      const VU bit = hn::Sub(hn::Add(hn::MulEven(hn::BitCast(du32, local), row_bits), before), one);
      const auto outside = hn::Eq(before, hn::Zero(du));
      const VU crossing = hn::IfThenElse(outside, hn::Or(hn::ShiftLeft<32>(hn::Or(block, one)), local),
                                         hn::Or(hn::ShiftLeft<32>(block), bit));
      hn::StoreU(hn::Compress(crossing, hn::RebindMask(du, crossed)), du, out.crossing + out.count);
      out.count += std::popcount(lanes);
    }
  }
  // The few degenerate and edge-on ones.
  for (uint64_t left = used & ~Bits(d, plane.regular); left != 0; left &= left - 1) {
    const int k = std::countr_zero(left);
    const Vec3d &a = mesh.positions[uint32_t(v01[k])], &b = mesh.positions[v01[k] >> 32], &c = mesh.positions[v2[k]];
    ForEachCrossing(a, b, c, LinesOf(a, b, c, lines), lines.nx,
                    [&](int64_t y, int64_t z, int64_t before, bool falls) { out.Add(lines, y, z, before, falls); });
  }
}

HWY_ATTR void CrossSmall(const RowMesh& mesh, int64_t begin, int64_t end, const LineBlocks& lines, Crossings& out) {
  const DD d;
  const DU du;
  const DL dl;
  const hn::Rebind<uint32_t, DU> d32;
  const double* positions = &mesh.positions[0].x;
  // Triangles with lines in their box: vertices 0 and 1, and 2.
  HWY_ALIGN uint64_t v01[Crossings::kMaxTriangles + kHalf], v2[Crossings::kMaxTriangles + kHalf];
  int64_t kept = 0;
  for (int64_t t = begin; t < end; t += kHalf) {
    const int64_t count = std::min<int64_t>(kHalf, end - t);
    hn::Vec<decltype(d32)> i0, i1, i2;
    if (count == kHalf) {
      hn::LoadInterleaved3(d32, mesh.triangles[t], i0, i1, i2);
    } else {
      uint32_t padded[3 * kHalf];
      for (int64_t k = 0; k < 3 * kHalf; ++k) padded[k] = mesh.triangles[t + (k < 3 * count ? k / 3 : 0)][k % 3];
      hn::LoadInterleaved3(d32, padded, i0, i1, i2);
    }
    const VU v[3] = {hn::PromoteTo(du, i0), hn::PromoteTo(du, i1), hn::PromoteTo(du, i2)};
    VD y[3], z[3];
    for (int i = 0; i < 3; ++i) {
      const auto at = hn::BitCast(dl, hn::Add(v[i], hn::ShiftLeft<1>(v[i])));
      y[i] = hn::GatherIndex(d, positions + 1, at);
      z[i] = hn::GatherIndex(d, positions + 2, at);
    }
    const LinesD range = LinesOfD(y[0], y[1], y[2], z[0], z[1], z[2], lines);
    const VD rows = hn::Sub(range.y_end, range.y_begin), layers = hn::Sub(range.z_end, range.z_begin);
    const MD some = hn::And(hn::And(hn::Gt(rows, SetD(0)), hn::Gt(layers, SetD(0))), hn::FirstN(d, size_t(count)));
    const MD few = hn::And(hn::Le(rows, SetD(Crossings::kSmallRows)), hn::Le(layers, SetD(Crossings::kSmallRows)));
    const auto small = hn::RebindMask(du, hn::And(some, few));
    hn::StoreU(hn::Compress(hn::Or(v[0], hn::ShiftLeft<32>(v[1])), small), du, v01 + kept);
    hn::StoreU(hn::Compress(v[2], small), du, v2 + kept);
    kept += int64_t(hn::CountTrue(du, small));
    for (uint64_t lanes = Bits(d, hn::AndNot(few, some)); lanes != 0; lanes &= lanes - 1) {
      out.large[out.larges++] = uint32_t(t) + uint32_t(std::countr_zero(lanes));
    }
  }
  for (int64_t k = kept; k < kept + kHalf; ++k) v01[k] = v2[k] = 0;  // unused lanes need a valid vertex
  for (int64_t i = 0; i < kept; i += kHalf) {
    const int64_t here = std::min<int64_t>(kHalf, kept - i);
    CrossBatch(mesh, v01 + i, v2 + i, (uint64_t{1} << here) - 1, lines, out);
  }
}

// An edge of a large triangle, for its intersection with the line of a layer's centres.
struct TallEdge {
  double py, pz, qy, dy, dz, z_lo, z_hi, by_z;  // by_z: 1 / dz, 0 if the edge is almost parallel to y
  bool falls;                                   // the edge falls in y where it is crossed

  TallEdge(const Vec3d& a, const Vec3d& b) {
    const bool a_first = a.y < b.y || (a.y == b.y && a.z <= b.z);
    const Vec3d &p = a_first ? a : b, &q = a_first ? b : a;
    falls = !a_first;
    py = p.y, pz = p.z, qy = q.y, dy = q.y - p.y, dz = q.z - p.z;
    z_lo = voxelpipe::Min(p.z, q.z), z_hi = voxelpipe::Max(p.z, q.z);
    by_z = Abs(dz) > 0x1p-20 ? 1 / dz : 0;
  }

  // Grows [lo, hi] by the y of the edge's points within kLineSlack of z.
  void Meet(double z, double& lo, double& hi) const {
    if (z + kLineSlack < z_lo || z - kLineSlack > z_hi) return;
    double first = 0, last = 1;
    if (by_z != 0) {
      const double s = (z - kLineSlack - pz) * by_z, t = (z + kLineSlack - pz) * by_z;
      first = Clamp(voxelpipe::Min(s, t), 0.0, 1.0);
      last = Clamp(voxelpipe::Max(s, t), 0.0, 1.0);
    }
    lo = voxelpipe::Min(lo, py + dy * first);
    hi = voxelpipe::Max(hi, py + dy * last);
  }
};

HWY_ATTR void CrossLarge(const RowMesh& mesh, uint32_t id, const LineBlocks& lines, int64_t block,
                         const BlockToggles& out) {
  const DD d;
  const uint32_t* v = mesh.triangles[id];
  const Vec3d &a = mesh.positions[v[0]], &b = mesh.positions[v[1]], &c = mesh.positions[v[2]];
  const auto all = [](const Vec3d& p) HWY_ATTR { return VecD{SetD(p.x), SetD(p.y), SetD(p.z)}; };
  const PlaneD plane = SetUpPlaneD(all(a), all(b), all(c));
  if (!hn::AllTrue(d, plane.regular)) return CrossLargePlain(a, b, c, lines, block, out);
  const TallEdge edges[3] = {TallEdge(a, b), TallEdge(b, c), TallEdge(c, a)};
  HWY_ALIGN double before_out[kHalf];
  const auto layer = [&](int64_t z, int64_t y_begin, int64_t y_end, int64_t row) HWY_ATTR {
    const double pz = double(z) + 0.5;
    double lo = double(y_end), hi = double(y_begin);
    for (const TallEdge& e : edges) e.Meet(pz, lo, hi);
    const int64_t first = int64_t(Clamp(ceil(lo - (0.5 + kLineSlack)), double(y_begin), double(y_end)));
    const int64_t end = int64_t(Clamp(floor(hi - (0.5 - kLineSlack)) + 1, double(y_begin), double(y_end)));
    VD rise[3];
    for (int e = 0; e < 3; ++e) rise[e] = SetD(edges[e].dy * (pz - edges[e].pz));
    for (int64_t y0 = first; y0 < end; y0 += kHalf) {
      const VD py = hn::Add(hn::Add(SetD(double(y0)), hn::Iota(d, 0)), SetD(0.5));
      MD above[3];
      for (int e = 0; e < 3; ++e) {
        const MD straddles = hn::AndNot(hn::Le(SetD(edges[e].qy), py), hn::Le(SetD(edges[e].py), py));
        const VD run = hn::Mul(SetD(edges[e].dz), hn::Sub(py, SetD(edges[e].py)));
        above[e] = hn::And(straddles, hn::Lt(hn::Sub(rise[e], run), hn::Zero(d)));
      }
      const MD here = hn::FirstN(d, size_t(std::min<int64_t>(kHalf, end - y0)));
      const uint64_t crossed = Bits(d, hn::And(here, hn::Xor(hn::Xor(above[0], above[1]), above[2])));
      if (crossed == 0) continue;
      uint64_t falls = 0;
      for (int e = 0; e < 3; ++e) falls |= edges[e].falls ? Bits(d, above[e]) : 0;
      const VD ny_dy = hn::Mul(plane.normal.y, hn::Sub(hn::Sub(py, plane.base.y), plane.v0.y));
      hn::Store(BeforeD(plane, ny_dy, SetD(pz), double(lines.nx)), d, before_out);
      for (uint64_t lanes = crossed; lanes != 0; lanes &= lanes - 1) {
        const int k = std::countr_zero(lanes);
        ToggleRow(lines, out, row + y0 + k, int64_t(before_out[k]), (falls >> k & 1) != 0);
      }
    }
  };
  ForEachLayerOfBlock(lines, block, LinesOf(a, b, c, lines), layer);
}

HWY_ATTR int64_t SpreadToggles(const BlockToggles& in, int64_t rows, int64_t words_per_row, uint32_t* out, bool add) {
  const hn::ScalableTag<uint32_t> d;
  const auto one = hn::Set(d, 1u), ones = hn::Set(d, ~0u);
  int64_t odd = 0;
  for (int64_t r = 0; r < rows; ++r, out += words_per_row) {
    const uint32_t* const toggles = in.words + r * words_per_row;
    bool carry = false;
    for (int64_t w = (words_per_row - 1) / kLanes * kLanes; w >= 0; w -= kLanes) {
      const auto lanes = hn::FirstN(d, size_t(std::min<int64_t>(kLanes, words_per_row - w)));
      auto bits = hn::MaskedLoad(lanes, d, toggles + w);
      if (!carry && hn::AllTrue(d, hn::Eq(bits, hn::Zero(d)))) {
        if (!add) hn::BlendedStore(bits, lanes, d, out + w);
        continue;
      }
      bits = hn::Xor(bits, hn::ShiftRight<1>(bits));
      bits = hn::Xor(bits, hn::ShiftRight<2>(bits));
      bits = hn::Xor(bits, hn::ShiftRight<4>(bits));
      bits = hn::Xor(bits, hn::ShiftRight<8>(bits));
      bits = hn::Xor(bits, hn::ShiftRight<16>(bits));
      // Bit 0 of a word is now its parity. Each word adds the parity of all words after it.
      uint64_t parity = Bits(d, hn::Eq(hn::And(bits, one), one));
      for (int shift = 1; shift < kLanes; shift *= 2) parity ^= parity >> shift;
      uint64_t beyond = parity >> 1;
      if (carry) beyond = ~beyond;
      carry = carry != ((parity & 1) != 0);
      const auto flip = hn::LoadMaskBits(d, reinterpret_cast<const uint8_t*>(&beyond));
      bits = hn::Xor(bits, hn::IfThenElseZero(flip, ones));
      if (add) bits = hn::Or(bits, hn::MaskedLoad(lanes, d, out + w));
      hn::BlendedStore(bits, lanes, d, out + w);
    }
    odd += carry != ((in.outside[r / 32] >> (r % 32) & 1) != 0);
  }
  return odd;
}

}  // namespace HWY_NAMESPACE
}  // namespace voxelpipe::cpu
HWY_AFTER_NAMESPACE();

#endif  // HWY_TARGET
#endif  // include guard
