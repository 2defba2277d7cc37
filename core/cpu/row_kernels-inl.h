// The row kernels on vectors: the operations of raster/triangle_setup.h and raster/spans.h, lane by lane in the same order.
// Included once for each instruction set; no include guard but Highway's.
//
// Sources: as triangle_setup.h. The schedule (many small triangles a vector, many rows of a large one) follows M. Schwarz and
// H.-P. Seidel, "Fast Parallel Surface and Solid Voxelization on GPUs", 2010, in sorting triangles by their extent.
#if defined(VOXELPIPE_ROW_KERNELS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef VOXELPIPE_ROW_KERNELS_INL_H_
#undef VOXELPIPE_ROW_KERNELS_INL_H_
#else
#define VOXELPIPE_ROW_KERNELS_INL_H_
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cstring>

#include "cpu/row_kernels.h"
#include "grid/index_space.h"

#if HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3

HWY_BEFORE_NAMESPACE();
namespace voxelpipe::cpu {
namespace HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using DF = hn::ScalableTag<float>;
using DI = hn::ScalableTag<int32_t>;
using DD = hn::ScalableTag<double>;
using DL = hn::ScalableTag<int64_t>;
using DU = hn::ScalableTag<uint64_t>;
using DS = hn::ScalableTag<int16_t>;
using VF = hn::Vec<DF>;
using VI = hn::Vec<DI>;
using VD = hn::Vec<DD>;
using MF = hn::Mask<DF>;
constexpr int kLanes = HWY_TARGET == HWY_AVX3 ? 16 : 8;  // floats
constexpr int kHalf = kLanes / 2;                        // doubles
constexpr int64_t kNearWords = 1 << 22;                  // 16 MiB of bits are near enough without being asked for

HWY_INLINE VF SetF(float v) {
  return hn::Set(DF(), v);
}
HWY_INLINE VI SetI(int64_t v) {
  return hn::Set(DI(), int32_t(v));
}
HWY_INLINE VD SetD(double v) {
  return hn::Set(DD(), v);
}

// Bit i: lane i of the mask.
template <class D>
HWY_INLINE uint64_t Bits(D d, hn::Mask<D> mask) {
  uint8_t bytes[8] = {};
  hn::StoreMaskBits(d, mask, bytes);
  uint64_t bits;
  std::memcpy(&bits, bytes, sizeof bits);
  return bits;
}

// ---- vertices ----

HWY_ATTR bool Bounds(const Vec3d* world, int64_t begin, int64_t end, Vec3d& least, Vec3d& most) {
  const DD d;
  const double* in = &world[0].x;
  VD lo[3], hi[3], odd = hn::Zero(d);  // odd: 0 while all are finite, x - x being NaN for NaN and infinity
  for (int a = 0; a < 3; ++a) lo[a] = hi[a] = SetD(world[begin][a]);
  int64_t i = begin;
  for (; i + kHalf <= end; i += kHalf) {
    VD p[3];
    hn::LoadInterleaved3(d, in + 3 * i, p[0], p[1], p[2]);
    for (int a = 0; a < 3; ++a) {
      lo[a] = hn::Min(lo[a], p[a]);
      hi[a] = hn::Max(hi[a], p[a]);
      odd = hn::Add(odd, hn::Sub(p[a], p[a]));
    }
  }
  bool finite = hn::AllTrue(d, hn::Eq(odd, hn::Zero(d)));
  for (int a = 0; a < 3; ++a) {
    least[a] = hn::GetLane(hn::MinOfLanes(d, lo[a]));
    most[a] = hn::GetLane(hn::MaxOfLanes(d, hi[a]));
  }
  for (; i < end; ++i) {
    for (int a = 0; a < 3; ++a) {
      finite = finite && Abs(world[i][a]) < HUGE_VAL;
      least[a] = voxelpipe::Min(least[a], world[i][a]);
      most[a] = voxelpipe::Max(most[a], world[i][a]);
    }
  }
  return finite;
}

// 2*first + (last - first) = first + last, see VertexCode. As an integer in the low bits of a double's.
HWY_INLINE hn::Vec<DU> CodeOf(VD p) {
  const VD first = hn::Ceil(hn::Sub(p, SetD((0.5 + 0.5) + kNarrowWidening)));
  const VD last = hn::Floor(hn::Sub(p, SetD((0.5 - 0.5) - kNarrowWidening)));
  const VD code = hn::Min(hn::Max(hn::Add(first, last), SetD(-32768.0)), SetD(32767.0));
  return hn::And(hn::BitCast(DU(), hn::Add(code, SetD(0x1.8p52))), hn::Set(DU(), uint64_t{0xffff}));
}

// a / h, given 1/h: the quotient by the inverse, corrected twice by the remainder, is the rounded one (P. Markstein, "Computation of
// Elementary Functions on the IBM RISC System/6000 Processor", 1990) where no step can under- or overflow and h's last bits are not all
// ones. A third of a division's time.
struct Divisor {
  double h, inverse;
  bool regular;
  explicit Divisor(double size) : h(size), inverse(1 / size) {
    uint64_t bits;
    std::memcpy(&bits, &size, sizeof bits);
    regular = size >= 0x1p-250 && size <= 0x1p250 && (bits << 12) != (~uint64_t{0} << 12);
  }
};
constexpr double kLeastDividend = 0x1p-250, kMostDividend = 0x1p250;
HWY_INLINE VD QuotientOfRegular(VD a, const Divisor& d) {
  const VD h = SetD(d.h), inverse = SetD(d.inverse);
  const VD q = hn::Mul(a, inverse);
  const VD closer = hn::MulAdd(hn::NegMulAdd(q, h, a), inverse, q);
  return hn::MulAdd(hn::NegMulAdd(closer, h, a), inverse, closer);
}

HWY_ATTR Placed Place(const Vec3d* world, int64_t begin, int64_t end, const Vec3d& origin, const Vec3d& voxel_size,
                      Vec3d* index, VertexCode* codes) {
  const DD d;
  const DU du;
  const double* in = &world[0].x;
  const Divisor divisors[3] = {Divisor(voxel_size.x), Divisor(voxel_size.y), Divisor(voxel_size.z)};
  Placed placed{true, divisors[0].regular && divisors[1].regular && divisors[2].regular};
  const bool quick = placed.regular;
  VD far = SetD(0);
  for (int64_t i = begin; i < end; i += kHalf) {
    VD p[3];
    const int64_t count = std::min<int64_t>(kHalf, end - i);
    if (count == kHalf) {
      hn::LoadInterleaved3(d, in + 3 * i, p[0], p[1], p[2]);
    } else {
      HWY_ALIGN double padded[3 * kHalf];
      for (int64_t k = 0; k < 3 * kHalf; ++k) padded[k] = in[3 * i + (k < 3 * count ? k : k % 3)];
      hn::LoadInterleaved3(d, padded, p[0], p[1], p[2]);
    }
    VD q[3], least = SetD(kMostDividend), most = SetD(0);
    for (int a = 0; a < 3; ++a) {
      p[a] = hn::Sub(p[a], SetD(origin[a]));
      const VD size = hn::Abs(p[a]);
      least = hn::Min(least, size);
      most = hn::Max(most, size);
      q[a] = QuotientOfRegular(p[a], divisors[a]);
    }
    // A zero is divided too, for the sign of its quotient: only the box's own corners have one.
    const auto in_range = hn::And(hn::Ge(least, SetD(kLeastDividend)), hn::Le(most, SetD(kMostDividend)));
    if (HWY_UNLIKELY(!quick || !hn::AllTrue(d, in_range))) {
      for (int a = 0; a < 3; ++a) {
        q[a] = hn::Div(p[a], SetD(divisors[a].h));
        const VD size = hn::Abs(p[a]);
        placed.regular = placed.regular &&
                         hn::AllTrue(d, hn::Or(hn::Eq(size, hn::Zero(d)), hn::And(hn::Ge(size, SetD(kLeastDividend)),
                                                                                  hn::Le(size, SetD(kMostDividend)))));
      }
    }
    for (int a = 0; a < 3; ++a) far = hn::Max(far, hn::Abs(q[a]));
    const auto code = hn::Or(CodeOf(q[0]), hn::Or(hn::ShiftLeft<16>(CodeOf(q[1])), hn::ShiftLeft<32>(CodeOf(q[2]))));
    if (count == kHalf) {
      hn::StoreU(code, du, reinterpret_cast<uint64_t*>(codes + i));
      if (index != nullptr) hn::StoreInterleaved3(q[0], q[1], q[2], d, &index[i].x);
    } else {
      HWY_ALIGN uint64_t code_out[kHalf];
      HWY_ALIGN double out[3][kHalf];
      hn::Store(code, du, code_out);
      for (int a = 0; a < 3; ++a) hn::Store(q[a], d, out[a]);
      std::memcpy(codes + i, code_out, size_t(count) * sizeof(VertexCode));
      for (int64_t k = 0; k < count && index != nullptr; ++k) index[i + k] = {out[0][k], out[1][k], out[2][k]};
    }
  }
  placed.near = hn::AllTrue(d, hn::Le(far, SetD(0x1p40)));
  return placed;
}

// ---- boxes ----

// A stretch of triangles between the two halves of a scan: boxes of at most two rows, one word in each.
struct TwoWords {
  static constexpr int64_t kMost = 256;  // triangles
  HWY_ALIGN uint32_t word[2][kMost];     // of the slab
  HWY_ALIGN uint32_t bits[kMost];        // of both words; 0: not such a box
  HWY_ALIGN uint32_t shape[kMost];       // kIsRun, or as in RowLists
};
constexpr uint32_t kIsRun = 1 << 16;

// Boxes and classes of triangles [begin, end), at most TwoWords::kMost. What is not for `boxes` is set or listed here. Asks early for
// the memory that will be looked at.
HWY_INLINE void ScanBoxes(const RowMesh& mesh, int64_t begin, int64_t end, Coverage coverage, const RowSlab& slab,
                          RowLists& lists, TwoWords& boxes) {
  const DU du;
  const DL dl;
  const DS ds;
  const hn::Rebind<uint32_t, DU> d32;
  using VU = hn::Vec<DU>;
  const hn::Repartition<uint32_t, DU> du32;
  const auto codes = reinterpret_cast<const uint64_t*>(mesh.codes);
  const auto packed = [](int64_t x, int64_t y, int64_t z) {
    return uint64_t(uint16_t(x)) | uint64_t(uint16_t(y)) << 16 | uint64_t(uint16_t(z)) << 32;
  };
  const auto set = [&](uint64_t v) HWY_ATTR { return hn::Set(du, v); };
  const auto least = hn::BitCast(ds, set(packed(0, 0, slab.begin)));
  const auto most = hn::BitCast(ds, set(packed(slab.nx - 1, slab.ny - 1, slab.end - 1)));
  const auto one16 = hn::Set(ds, int16_t{1});
  const VU one = set(1), two = set(2), low5 = set(31), low16 = set(0xffff), in_y = set(uint64_t{0xffff} << 16);
  const VU in_z = set(uint64_t{0xffff} << 32), in_yz = hn::Or(in_y, in_z);
  const VU words_per_row = set(uint64_t(slab.words_per_row)), rows_per_layer = set(uint64_t(slab.ny));
  const VU words_per_layer = set(uint64_t(slab.words_per_row * slab.ny)), z_begin = set(uint64_t(slab.begin));
  const auto extents_above = [&](hn::Vec<DS> extent, int16_t bound) HWY_ATTR {
    return hn::Ne(hn::And(hn::BitCast(du, hn::VecFromMask(ds, hn::Gt(extent, hn::Set(ds, bound)))), in_yz),
                  hn::Zero(du));
  };
  const auto product = [&](VU a, VU b) HWY_ATTR { return hn::MulEven(hn::BitCast(du32, a), hn::BitCast(du32, b)); };
  const bool conservative = coverage == Coverage::kConservative, in_place = slab.words != nullptr;
  const bool prefetch = in_place && slab.words_per_row * slab.ny * (slab.end - slab.begin) > kNearWords;
  HWY_ALIGN uint64_t before[kHalf];
  for (uint64_t k = 0; k < kHalf; ++k) before[k] = (k + kHalf - 1) % kHalf;
  const auto lane_before = hn::SetTableIndices(du, before);
  HWY_ALIGN uint64_t first_out[kHalf], last_out[kHalf], word_out[kHalf], row_out[kHalf], layer_out[kHalf];
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
    const auto code_of = [&](hn::Vec<decltype(d32)> v) HWY_ATTR {
      return hn::BitCast(ds, hn::GatherIndex(du, codes, hn::BitCast(dl, hn::PromoteTo(du, v))));
    };
    const auto a = code_of(i0), b = code_of(i1), c = code_of(i2);
    const auto first = hn::ShiftRight<1>(hn::Min(a, hn::Min(b, c)));
    const auto last = hn::ShiftRight<1>(hn::SaturatedAdd(hn::Max(a, hn::Max(b, c)), one16));
    const auto outside = hn::Or(hn::Lt(last, least), hn::Gt(first, most));
    const auto clipped = hn::Or(hn::Lt(first, least), hn::Gt(last, most));
    const auto extent = hn::Sub(last, first);
    const VU f = hn::BitCast(du, first), l = hn::BitCast(du, last);
    const VU several = hn::BitCast(du, hn::VecFromMask(ds, hn::Gt(extent, hn::Zero(ds))));
    const auto is_run =
        hn::Eq(hn::And(several, hn::Or(hn::ShiftRight<16>(several), hn::ShiftRight<32>(several))), hn::Zero(du));
    const auto above_one = extents_above(extent, 1), above_small = extents_above(extent, kSmallRows - 1);
    const auto inside = hn::Eq(hn::BitCast(du, hn::VecFromMask(ds, outside)), hn::Zero(du));
    const VU e = hn::BitCast(du, extent);
    const VU shape = hn::Or(hn::And(hn::ShiftRight<16>(e), set(0xf)), hn::And(hn::ShiftRight<28>(e), set(0xf0)));
    uint64_t left = Bits(du, hn::And(inside, hn::FirstN(du, size_t(count))));
    if (in_place) {
      const VU x0 = hn::And(f, low16), x1 = hn::And(l, low16);
      const auto one_word = hn::Eq(hn::ShiftRight<5>(x0), hn::ShiftRight<5>(x1));
      const auto whole = hn::Eq(hn::BitCast(du, hn::VecFromMask(ds, clipped)), hn::Zero(du));
      const auto both = hn::Eq(hn::And(several, in_yz), in_yz);
      auto two_words = hn::AndNot(hn::Or(above_one, both), hn::And(one_word, whole));
      two_words = hn::And(two_words, hn::FirstN(du, size_t(count)));
      const VU y = hn::And(hn::ShiftRight<16>(f), low16), z = hn::Sub(hn::And(hn::ShiftRight<32>(f), low16), z_begin);
      const VU row = hn::Add(y, product(z, rows_per_layer));
      const VU word0 = hn::Add(product(row, words_per_row), hn::ShiftRight<5>(x0));
      const auto up = [&](VU axis, VU step)
                          HWY_ATTR { return hn::IfThenElseZero(hn::Ne(hn::And(several, axis), hn::Zero(du)), step); };
      const VU row_step = up(in_y, words_per_row), layer_step = up(in_z, words_per_layer);
      const VU mask = hn::Sub(hn::Shl(two, hn::And(x1, low5)), hn::Shl(one, hn::And(x0, low5)));
      const auto store = [&](VU v, uint32_t* to)
                             HWY_ATTR { hn::Store(hn::TruncateTo(d32, hn::IfThenElseZero(two_words, v)), d32, to); };
      const int64_t at = t - begin;
      store(word0, boxes.word[0] + at);
      store(hn::Add(word0, hn::Add(row_step, layer_step)), boxes.word[1] + at);
      store(mask, boxes.bits + at);
      store(conservative ? hn::IfThenElse(is_run, set(kIsRun), shape) : shape, boxes.shape + at);
      const uint64_t quick = Bits(du, two_words);
      if (prefetch) {
        // Neighbours mostly lie in the same words.
        const VU key = hn::Add(hn::ShiftLeft<8>(hn::ShiftRight<4>(word0)), shape);
        const uint64_t fresh = 1 | Bits(du, hn::Ne(key, hn::TableLookupLanes(key, lane_before)));
        hn::Store(word0, du, word_out);
        hn::Store(row_step, du, row_out);
        hn::Store(layer_step, du, layer_out);
        for (uint64_t lanes = left & fresh & Bits(du, whole); lanes != 0; lanes &= lanes - 1) {
          const int k = std::countr_zero(lanes);
          const uint32_t* const word = slab.words + word_out[k];
          __builtin_prefetch(word);
          __builtin_prefetch(word + row_out[k]);
          __builtin_prefetch(word + layer_out[k]);
          __builtin_prefetch(word + row_out[k] + layer_out[k]);
        }
      }
      left &= ~quick;
      const uint64_t runs = conservative ? left & Bits(du, is_run) : 0;
      left &= ~runs;
      if (HWY_UNLIKELY(runs != 0)) {
        hn::Store(f, du, first_out);
        hn::Store(l, du, last_out);
        for (uint64_t lanes = runs; lanes != 0; lanes &= lanes - 1) {
          const int k = std::countr_zero(lanes);
          const auto axis = [k](const uint64_t* from, int i) { return int64_t(int16_t(from[k] >> (16 * i))); };
          SetBox(slab, {axis(first_out, 0), axis(first_out, 1), axis(first_out, 2)},
                 {axis(last_out, 0), axis(last_out, 1), axis(last_out, 2)});
        }
      }
    }
    if (left == 0) continue;
    const uint64_t runs = conservative ? left & Bits(du, is_run) : 0, large = left & ~runs & Bits(du, above_small);
    for (uint64_t lanes = runs; lanes != 0; lanes &= lanes - 1) {
      lists.run[lists.runs++] = uint32_t(t) + uint32_t(std::countr_zero(lanes));
    }
    for (uint64_t lanes = large; lanes != 0; lanes &= lanes - 1) {
      lists.large[lists.larges++] = uint32_t(t) + uint32_t(std::countr_zero(lanes));
    }
    left &= ~(runs | large);
    const auto small = hn::LoadMaskBits(d32, reinterpret_cast<const uint8_t*>(&left));
    const auto ids = hn::Add(hn::Set(d32, uint32_t(t)), hn::Iota(d32, 0));
    hn::StoreU(hn::Compress(ids, small), d32, lists.small + lists.smalls);
    hn::StoreU(hn::Compress(hn::TruncateTo(d32, shape), small), d32, lists.shape + lists.smalls);
    lists.smalls += std::popcount(left);
  }
}

// Triangles from `begin` on whose words lack a bit of their box: sets runs, lists the others.
HWY_INLINE void ScanWords(int64_t begin, int64_t end, const RowSlab& slab, RowLists& lists, TwoWords& boxes) {
  const DI di;
  const hn::RebindToUnsigned<DI> du;
  const auto words = reinterpret_cast<const int32_t*>(slab.words);
  const int64_t count = end - begin;
  for (int64_t i = 0; i < count; i += kLanes) {
    const auto load = [&](const uint32_t* from) HWY_ATTR { return hn::BitCast(di, hn::Load(du, from + i)); };
    const VI held =
        hn::And(hn::GatherIndex(di, words, load(boxes.word[0])), hn::GatherIndex(di, words, load(boxes.word[1])));
    uint64_t lanes = Bits(di, hn::Ne(hn::AndNot(held, load(boxes.bits)), hn::Zero(di)));
    for (; lanes != 0; lanes &= lanes - 1) {
      const int64_t k = i + std::countr_zero(lanes);
      if (boxes.shape[k] != kIsRun) {
        lists.AddSmall(uint32_t(begin + k), boxes.shape[k]);
        continue;
      }
      OrWord(slab.words[boxes.word[0][k]], boxes.bits[k], slab.shared);
      OrWord(slab.words[boxes.word[1][k]], boxes.bits[k], slab.shared);
    }
  }
}

HWY_ATTR void Scan(const RowMesh& mesh, int64_t begin, int64_t end, Coverage coverage, const RowSlab& slab,
                   RowLists& lists) {
  TwoWords boxes;
  for (int64_t first = begin; first < end; first += TwoWords::kMost) {
    const int64_t last = std::min(end, first + TwoWords::kMost);
    // The last vector's lanes that no box is stored to.
    const int64_t tail = (last - first - 1) / kLanes * kLanes;
    for (uint32_t* of_boxes : {boxes.word[0], boxes.word[1], boxes.bits}) {
      hn::Store(hn::Zero(DI()), DI(), reinterpret_cast<int32_t*>(of_boxes + tail));
    }
    ScanBoxes(mesh, first, last, coverage, slab, lists, boxes);
    if (slab.words != nullptr) ScanWords(first, last, slab, lists, boxes);
  }
}

// ---- many small triangles a vector ----

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

// What BoundShape makes, for kLanes triangles.
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

// `inverse` is 1 / nu; au and at are the sizes of nu and nt, half_u and half_t widened.
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
HWY_INLINE WideVector ToIndexSpace(const RowMesh& mesh, VD lo, VD hi, double origin, const Divisor& divisor) {
  const VD a = hn::Sub(lo, SetD(origin)), b = hn::Sub(hi, SetD(origin));
  if (HWY_LIKELY(mesh.regular)) return {QuotientOfRegular(a, divisor), QuotientOfRegular(b, divisor)};
  return {hn::Div(a, SetD(divisor.h)), hn::Div(b, SetD(divisor.h))};
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
  WideVector p[3][3];  // vertex, axis
  for (int i = 0; i < 3; ++i) {
    for (int a = 0; a < 3; ++a) {
      p[i][a] = ToIndexSpace(mesh, hn::GatherIndex(DD(), positions + a, at[0][i]),
                             hn::GatherIndex(DD(), positions + a, at[1][i]), mesh.origin[a], divisors[a]);
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
    return hn::IfThenElseZero(hn::And(hn::Ge(longest, SetD(kNarrowLeast)), hn::Le(longest, SetD(kNarrowMost))),
                              SetD(1));
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

// The greatest lane of v where `m` is set, at least `least`.
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

// Bits to set, gathered densely before memory is looked at: one by one, each look would be a guess of the processor's.
struct WordList {
  static constexpr int64_t kMost = 512;
  int64_t count = 0;
  HWY_ALIGN int32_t word[kMost + kLanes];
  HWY_ALIGN int32_t bits[kMost + kLanes];
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
  hn::StoreU(hn::Zero(di), di, list.word + list.count);  // the last vector's other lanes
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
      if (HWY_UNLIKELY(list.count > WordList::kMost - 2 * kLanes)) Flush(slab, list);
    }
  }
}

// ---- many rows of one triangle a vector ----

// Clamped to a range of 32 bits before.
HWY_INLINE VI ToInt(VF v) {
  return hn::ConvertTo(DI(), v);
}
HWY_INLINE hn::Vec<hn::Half<DI>> ToInt(VD v) {
  return hn::DemoteTo(hn::Half<DI>(), v);
}

// Sets voxels [begin, end) of `rows` consecutive rows, at most a lane each; lanes where end <= begin have none.
template <class D>
HWY_INLINE void SetRows(D d, hn::Vec<D> begin, hn::Vec<D> end, int64_t rows, uint32_t* first_row, const RowSlab& slab) {
  constexpr int64_t kRows = int64_t(hn::MaxLanes(D()));
  const hn::RebindToUnsigned<D> du;
  const auto shifted = [&](hn::Vec<D> v, hn::Vec<D> by)
                           HWY_ATTR { return hn::BitCast(d, hn::Shl(hn::BitCast(du, v), hn::BitCast(du, by))); };
  const auto one = hn::Set(d, 1), low5 = hn::Set(d, 31);
  const auto last = hn::Sub(end, one), word = hn::ShiftRight<5>(begin), last_word = hn::ShiftRight<5>(last);
  const auto lane = hn::Iota(d, 0);
  const auto hit = hn::And(hn::Gt(end, begin), hn::Lt(lane, hn::Set(d, int32_t(rows))));
  if (hn::AllFalse(d, hit)) return;
  const auto head = hn::Sub(hn::Zero(d), shifted(one, hn::And(begin, low5)));
  const auto tail = hn::Sub(shifted(hn::Set(d, 2), hn::And(last, low5)), one);
  const auto one_word = hn::Eq(word, last_word);
  const auto bits = hn::IfThenElseZero(hit, hn::And(head, hn::IfThenElse(one_word, tail, hn::Set(d, -1))));
  const auto row = hn::Mul(lane, hn::Set(d, int32_t(slab.words_per_row)));
  const auto at = hn::Add(row, hn::IfThenElseZero(hit, word));
  auto* const words = reinterpret_cast<int32_t*>(first_row);
  HWY_ALIGN int32_t word_out[kRows], bits_out[kRows], last_out[kRows];
  if (rows == kRows && !slab.shared) {  // each lane has a word of its own, even where it sets none of its bits
    hn::ScatterIndex(hn::Or(hn::GatherIndex(d, words, at), bits), d, words, at);
  } else {
    hn::Store(at, d, word_out);
    hn::Store(bits, d, bits_out);
    for (uint64_t left = Bits(d, hit); left != 0; left &= left - 1) {
      const int k = std::countr_zero(left);
      OrWord(first_row[word_out[k]], uint32_t(bits_out[k]), slab.shared);
    }
  }
  uint64_t left = Bits(d, hn::AndNot(one_word, hit));
  if (left == 0) return;
  hn::Store(begin, d, word_out);
  hn::Store(last, d, last_out);
  for (; left != 0; left &= left - 1) {
    const int k = std::countr_zero(left);
    SetBits(first_row + k * slab.words_per_row, (word_out[k] | 31) + 1, int64_t{last_out[k]} + 1, slab.shared);
  }
}

template <typename Real>
HWY_INLINE void RasterTall(const SpanBounds<Real>& s, const Vec3d& base, const VoxelRange& range, const RowSlab& slab) {
  const hn::ScalableTag<Real> d;
  const hn::Rebind<int32_t, decltype(d)> di;
  constexpr int64_t kRows = kLanes * sizeof(float) / sizeof(Real);
  const double y_lo = double(range.begin[1]), y_hi = double(range.end[1]);
  const auto x_lo = hn::Set(d, Real(double(range.begin[0]) - base.x)),
             x_hi = hn::Set(d, Real(double(range.end[0]) - base.x));
  // From the range's first voxel on, both it and the local coordinates have few digits.
  const auto x_begin = hn::Set(di, int32_t(range.begin[0]));
  for (int64_t z = range.begin[2]; z < range.end[2]; ++z) {
    const Layer<Real> layer = ComputeLayer(s, Real(double(z) - base.z));
    if (layer.y.empty() || layer.x.empty()) continue;
    const int64_t y_begin = int64_t(Clamp(base.y + double(layer.y.first), y_lo, y_hi));
    const int64_t y_end = int64_t(Clamp((base.y + double(layer.y.last)) + 1, y_lo, y_hi));
    for (int64_t y0 = y_begin; y0 < y_end; y0 += kRows) {
      const auto y = hn::Add(hn::Set(d, Real(double(y0) - base.y)), hn::Iota(d, Real(0)));
      auto first = hn::Set(d, layer.x.first), last = hn::Set(d, layer.x.last);
      for (int i = 0; i < 3; ++i) {
        const auto shift = hn::Mul(hn::Set(d, s.x_of_y[i].s), y);
        first = hn::Max(first, hn::Sub(hn::Set(d, s.x_of_y[i].lo), shift));
        last = hn::Min(last, hn::Sub(hn::Set(d, s.x_of_y[i].hi), shift));
      }
      const auto shift = hn::Mul(hn::Set(d, s.plane_sy), y);
      first = hn::Ceil(hn::Max(first, hn::Sub(hn::Set(d, layer.plane_lo), shift)));
      last = hn::Floor(hn::Min(last, hn::Sub(hn::Set(d, layer.plane_hi), shift)));
      const auto end = hn::Add(last, hn::Set(d, Real(1)));
      const auto grid_x = [&](hn::Vec<decltype(d)> x) HWY_ATTR {
        return hn::Add(x_begin, ToInt(hn::Sub(hn::Min(hn::Max(x, x_lo), x_hi), x_lo)));
      };
      SetRows(di, grid_x(first), grid_x(end), std::min(kRows, y_end - y0),
              slab.words + (y0 + slab.ny * (z - slab.begin)) * slab.words_per_row, slab);
    }
  }
}

HWY_ATTR void RasterLarge(const RowMesh& mesh, const uint32_t* ids, int64_t count, Coverage coverage,
                          const RowSlab& slab) {
  const VoxelRange all{{0, 0, slab.begin}, {slab.nx, slab.ny, slab.end}};
  const auto at = [&](uint32_t v) { return WorldToIndex(mesh.origin, mesh.voxel_size, mesh.positions[v]); };
  for (int64_t i = 0; i < count; ++i) {
    const uint32_t* v = mesh.triangles[ids[i]];
    const TriangleSetup setup = SetUpTriangle(at(v[0]), at(v[1]), at(v[2]), coverage);
    const VoxelRange range = ClipToRange(setup, all);
    if (range.empty()) continue;
    if (setup.span_class == SpanClass::kNarrow) {
      RasterTall(setup.narrow, setup.base, range, slab);
    } else if (setup.span_class == SpanClass::kWide) {
      RasterTall(setup.wide, setup.base, range, slab);
    } else {
      SetBox(slab, {range.begin[0], range.begin[1], range.begin[2]},
             {range.end[0] - 1, range.end[1] - 1, range.end[2] - 1});
    }
  }
}

template <Coverage kCoverage>
HWY_ATTR void RasterSmallAs(const RowMesh& mesh, const uint32_t* ids, int64_t count, const RowSlab& slab) {
  const Divisor divisors[3] = {Divisor(mesh.voxel_size.x), Divisor(mesh.voxel_size.y), Divisor(mesh.voxel_size.z)};
  HWY_ALIGN uint32_t padded[kLanes];
  WordList list;
  for (int64_t i = 0; i < count; i += kLanes) {
    const int64_t here = std::min<int64_t>(kLanes, count - i);
    const uint32_t* batch_ids = ids + i;
    if (here < kLanes) {
      for (int64_t k = 0; k < kLanes; ++k) padded[k] = ids[i + std::min(k, here - 1)];
      batch_ids = padded;
    }
    Batch batch;
    SetUpBatch<kCoverage>(mesh, divisors, batch_ids, batch);
    const uint64_t used = here == kLanes ? (uint64_t{1} << kLanes) - 1 : (uint64_t{1} << here) - 1;
    const uint64_t wide = used & ~Bits(DF(), batch.narrow);
    RasterBatch(batch, slab, list);
    if (list.count > WordList::kMost / 2) Flush(slab, list);
    for (uint64_t left = wide; left != 0; left &= left - 1) {
      RasterLarge(mesh, batch_ids + std::countr_zero(left), 1, kCoverage, slab);
    }
  }
  Flush(slab, list);
}

HWY_ATTR void RasterSmall(const RowMesh& mesh, const uint32_t* ids, int64_t count, Coverage coverage,
                          const RowSlab& slab) {
  switch (coverage) {
    case Coverage::kConservative: return RasterSmallAs<Coverage::kConservative>(mesh, ids, count, slab);
    case Coverage::kThin: return RasterSmallAs<Coverage::kThin>(mesh, ids, count, slab);
    case Coverage::kCenter: return RasterSmallAs<Coverage::kCenter>(mesh, ids, count, slab);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace voxelpipe::cpu
HWY_AFTER_NAMESPACE();

#endif  // HWY_TARGET
#endif  // include guard
