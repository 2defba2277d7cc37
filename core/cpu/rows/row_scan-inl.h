// Codes of vertices, and the scan that sets runs and lists the triangles that need a set-up: by integer
// boxes, several triangles per vector. Included once for each instruction set; no include guard but Highway's.
#if defined(VOXELPIPE_ROW_SCAN_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef VOXELPIPE_ROW_SCAN_INL_H_
#undef VOXELPIPE_ROW_SCAN_INL_H_
#else
#define VOXELPIPE_ROW_SCAN_INL_H_
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <bit>

#include "cpu/rows/row_kernels.h"
#include "cpu/rows/row_lanes-inl.h"
#include "grid/index_space.h"

#if HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3

HWY_BEFORE_NAMESPACE();
namespace voxelpipe::cpu {
namespace HWY_NAMESPACE {

// ---- vertices ----

// 2*first + (last - first) = first + last, see VertexCode. As an integer in the low bits of a double's.
HWY_INLINE hn::Vec<DU> CodeOf(VD p) {
  const VD first = hn::Ceil(hn::Sub(p, SetD((0.5 + 0.5) + kNarrowWidening)));
  const VD last = hn::Floor(hn::Sub(p, SetD((0.5 - 0.5) - kNarrowWidening)));
  const VD code = hn::Min(hn::Max(hn::Add(first, last), SetD(-32768.0)), SetD(32767.0));
  return hn::And(hn::BitCast(DU(), hn::Add(code, SetD(0x1.8p52))), hn::Set(DU(), uint64_t{0xffff}));
}

// a / h, given 1/h: the quotient by the inverse, corrected twice by the remainder, is the rounded one (P. Markstein,
// "Computation of Elementary Functions on the IBM RISC System/6000 Processor", 1990) where no step can under- or
// overflow and h's last bits are not all ones. Takes a third of the time of a division.
struct Divisor {
  double h, inverse;
  bool regular;
  explicit Divisor(double size) : h(size), inverse(1 / size) {
    uint64_t bits;
    std::memcpy(&bits, &size, sizeof bits);
    regular = size >= 0x1p-250 && size <= 0x1p250 && (bits << 12) != (~uint64_t{0} << 12);
  }
};
constexpr double kMinDividend = 0x1p-250, kMaxDividend = 0x1p250;
HWY_INLINE VD QuotientOfRegular(VD a, const Divisor& d) {
  const VD h = SetD(d.h), inverse = SetD(d.inverse);
  const VD q = hn::Mul(a, inverse);
  const VD closer = hn::MulAdd(hn::NegMulAdd(q, h, a), inverse, q);
  return hn::MulAdd(hn::NegMulAdd(closer, h, a), inverse, closer);
}

// ToWalls along one axis.
HWY_INLINE VD ToWallD(const IndexSpace& space, int axis, VD at) {
  const VD wall = SetD(space.wall[axis]);
  const auto beyond = hn::And(hn::Gt(at, wall), hn::Le(at, SetD(space.wall_end[axis])));
  return hn::IfThenElse(beyond, wall, at);
}

HWY_ATTR Placed Place(const Vec3d* world, int64_t begin, int64_t end, const IndexSpace& space, Vec3d* index,
                      VertexCode* codes) {
  const DD d;
  const DU du;
  const double* in = &world[0].x;
  const Divisor divisors[3] = {Divisor(space.voxel_size.x), Divisor(space.voxel_size.y), Divisor(space.voxel_size.z)};
  Placed placed{true, divisors[0].regular && divisors[1].regular && divisors[2].regular};
  const bool quick = placed.regular, walls = space.has_walls();
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
    VD q[3], least = SetD(kMaxDividend), most = SetD(0);
    for (int a = 0; a < 3; ++a) {
      p[a] = hn::Sub(p[a], SetD(space.origin[a]));
      const VD size = hn::Abs(p[a]);
      least = hn::Min(least, size);
      most = hn::Max(most, size);
      q[a] = QuotientOfRegular(p[a], divisors[a]);
    }
    // A zero is divided too, for the sign of its quotient: only the box's own corners have one.
    const auto in_range = hn::And(hn::Ge(least, SetD(kMinDividend)), hn::Le(most, SetD(kMaxDividend)));
    if (HWY_UNLIKELY(!quick || !hn::AllTrue(d, in_range))) {
      for (int a = 0; a < 3; ++a) {
        q[a] = hn::Div(p[a], SetD(divisors[a].h));
        const VD size = hn::Abs(p[a]);
        placed.regular = placed.regular &&
                         hn::AllTrue(d, hn::Or(hn::Eq(size, hn::Zero(d)), hn::And(hn::Ge(size, SetD(kMinDividend)),
                                                                                  hn::Le(size, SetD(kMaxDividend)))));
      }
    }
    if (HWY_UNLIKELY(walls)) {
      for (int a = 0; a < 3; ++a) q[a] = ToWallD(space, a, q[a]);
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

// A range of triangles between the two halves of a scan: boxes of at most two rows, one word in each.
struct TwoWords {
  static constexpr int64_t kMaxTriangles = 256;  // triangles
  HWY_ALIGN uint32_t word[2][kMaxTriangles];     // of the slab
  HWY_ALIGN uint32_t bits[kMaxTriangles];        // of both words; 0: another kind of box
  HWY_ALIGN uint32_t shape[kMaxTriangles];       // kIsRun, or as in RowLists
};
constexpr uint32_t kIsRun = 1 << 16;

// Boxes and classes of triangles [begin, end), at most TwoWords::kMaxTriangles. Triangles that do not fit in `boxes`
// are set or listed here. Prefetches the words that the second half reads.
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
        // Neighbours mostly share words.
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

// For triangles from `begin` on whose words lack a bit of their box: sets runs, lists the others.
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
  for (int64_t first = begin; first < end; first += TwoWords::kMaxTriangles) {
    const int64_t last = std::min(end, first + TwoWords::kMaxTriangles);
    // The unused lanes of the last vector.
    const int64_t tail = (last - first - 1) / kLanes * kLanes;
    for (uint32_t* of_boxes : {boxes.word[0], boxes.word[1], boxes.bits}) {
      hn::Store(hn::Zero(DI()), DI(), reinterpret_cast<int32_t*>(of_boxes + tail));
    }
    ScanBoxes(mesh, first, last, coverage, slab, lists, boxes);
    if (slab.words != nullptr) ScanWords(first, last, slab, lists, boxes);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace voxelpipe::cpu
HWY_AFTER_NAMESPACE();

#endif  // HWY_TARGET
#endif  // include guard
