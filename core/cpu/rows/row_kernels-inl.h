// The row kernels on vectors: several rows of a large triangle per vector, and the table of the other kernels of this
// set. Included once for each instruction set; no include guard but Highway's.
//
// Sources: as triangle_setup.h. Sorting triangles by their extent (several small triangles per vector, several rows of
// a large one) follows M. Schwarz and H.-P. Seidel, "Fast Parallel Surface and Solid Voxelization on GPUs", 2010.
#if defined(VOXELPIPE_ROW_KERNELS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef VOXELPIPE_ROW_KERNELS_INL_H_
#undef VOXELPIPE_ROW_KERNELS_INL_H_
#else
#define VOXELPIPE_ROW_KERNELS_INL_H_
#endif

#include <hwy/highway.h>

#include <algorithm>

#include "cpu/rows/row_batch-inl.h"
#include "cpu/rows/row_kernels.h"
#include "cpu/rows/row_lanes-inl.h"
#include "cpu/rows/row_scan-inl.h"

#if HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3

HWY_BEFORE_NAMESPACE();
namespace voxelpipe::cpu {
namespace HWY_NAMESPACE {

// ---- several rows of one triangle per vector ----

// Clamped to a range of 32 bits before.
HWY_INLINE VI ToInt(VF v) {
  return hn::ConvertTo(DI(), v);
}
HWY_INLINE hn::Vec<hn::Half<DI>> ToInt(VD v) {
  return hn::DemoteTo(hn::Half<DI>(), v);
}

// Sets voxels [begin, end) of `rows` consecutive rows, one lane a row; lanes with end <= begin set none.
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
  if (rows == kRows && !slab.shared) {  // each lane has a word of its own, also where it sets no bit
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
  const auto at = [&](uint32_t v) { return WorldToIndex(mesh.space, mesh.positions[v]); };
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
  const Divisor divisors[3] = {Divisor(mesh.space.voxel_size.x), Divisor(mesh.space.voxel_size.y),
                               Divisor(mesh.space.voxel_size.z)};
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
    if (list.count > WordList::kMaxWords / 2) Flush(slab, list);
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
    case Coverage::kNone: return;
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace voxelpipe::cpu
HWY_AFTER_NAMESPACE();

#endif  // HWY_TARGET
#endif  // include guard
