// The rows of many triangles in one tile on vectors: the set-up and the row tests of row_kernels-inl.h.
// Included once for each instruction set, after row_kernels-inl.h; no include guard but Highway's.
#if defined(VOXELPIPE_TILE_KERNELS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef VOXELPIPE_TILE_KERNELS_INL_H_
#undef VOXELPIPE_TILE_KERNELS_INL_H_
#else
#define VOXELPIPE_TILE_KERNELS_INL_H_
#endif

#include "cpu/rows/row_kernels-inl.h"
#include "cpu/rows/tile_spans.h"

#if HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3

HWY_BEFORE_NAMESPACE();
namespace voxelpipe::cpu {
namespace HWY_NAMESPACE {

HWY_ATTR void TileBoxes(const uint32_t (*triangles)[3], const VertexCode* codes, int64_t begin, int64_t end,
                        const int64_t (&dims)[3], TileBox* boxes) {
  static_assert(TileDim(0) == 32 && TileDim(1) == 8 && TileDim(2) == 8 && sizeof(TileBox) == 16);
  const DU du;
  const DL dl;
  const DS ds;
  const hn::Rebind<uint32_t, DU> d32;
  const auto by_vertex = reinterpret_cast<const uint64_t*>(codes);
  const auto most =
      hn::BitCast(ds, hn::Set(du, uint64_t(dims[0] - 1) | uint64_t(dims[1] - 1) << 16 | uint64_t(dims[2] - 1) << 32));
  const auto zero = hn::Zero(ds), one = hn::Set(ds, int16_t{1});
  const auto in_x = hn::MaskFromVec(hn::BitCast(ds, hn::Set(du, uint64_t{0xffff})));
  const auto three = hn::Set(du, ~uint64_t{0} >> 16);
  const auto to_tiles = [&](hn::Vec<DS> v) HWY_ATTR {
    return hn::And(hn::BitCast(du, hn::IfThenElse(in_x, hn::ShiftRight<5>(v), hn::ShiftRight<3>(v))), three);
  };
  const auto any = [&](hn::Mask<DS> m) HWY_ATTR {
    return hn::Ne(hn::And(hn::BitCast(du, hn::VecFromMask(ds, m)), three), hn::Zero(du));
  };
  for (int64_t t = begin; t < end; t += kHalf) {
    const int64_t count = std::min<int64_t>(kHalf, end - t);
    hn::Vec<decltype(d32)> v[3];
    if (count == kHalf) {
      hn::LoadInterleaved3(d32, triangles[t], v[0], v[1], v[2]);
    } else {
      uint32_t padded[3 * kHalf];
      for (int64_t k = 0; k < 3 * kHalf; ++k) padded[k] = triangles[t + (k < 3 * count ? k / 3 : 0)][k % 3];
      hn::LoadInterleaved3(d32, padded, v[0], v[1], v[2]);
    }
    const auto code_of = [&](hn::Vec<decltype(d32)> id) HWY_ATTR {
      return hn::BitCast(ds, hn::GatherIndex(du, by_vertex, hn::BitCast(dl, hn::PromoteTo(du, id))));
    };
    const auto a = code_of(v[0]), b = code_of(v[1]), c = code_of(v[2]);
    const auto first = hn::ShiftRight<1>(hn::Min(a, hn::Min(b, c)));
    const auto last = hn::ShiftRight<1>(hn::SaturatedAdd(hn::Max(a, hn::Max(b, c)), one));
    const auto large = any(hn::Gt(hn::Sub(last, first), hn::Set(ds, TileBox::kMaxExtent)));
    const auto outside = any(hn::Or(hn::Lt(last, zero), hn::Gt(first, most)));
    const auto kind = hn::IfThenElse(large, hn::Set(du, uint64_t(TileBox::kLarge) << 48),
                                     hn::IfThenZeroElse(outside, hn::Set(du, uint64_t(TileBox::kBoxed) << 48)));
    HWY_ALIGN uint64_t words[2][kHalf];
    hn::Store(hn::Or(to_tiles(hn::Max(first, zero)), kind), du, words[0]);
    hn::Store(to_tiles(hn::Min(last, most)), du, words[1]);
    auto* const out = reinterpret_cast<uint8_t*>(boxes + (t - begin));
    for (int64_t k = 0; k < count; ++k) {
      std::memcpy(out + 16 * k, &words[0][k], 8);
      std::memcpy(out + 16 * k + 8, &words[1][k], 8);
    }
  }
}

// Lanes whose coverage is their box: SpanClass::kRun.
template <Coverage kCoverage>
HWY_INLINE uint64_t RunLanes(const Batch& batch) {
  if (kCoverage != Coverage::kConservative) return 0;
  const auto x = hn::Eq(batch.first[0], batch.last[0]), y = hn::Eq(batch.first[1], batch.last[1]);
  const auto z = hn::Eq(batch.first[2], batch.last[2]);
  return Bits(DI(), hn::Or(hn::And(x, y), hn::Or(hn::And(y, z), hn::And(x, z))));
}

// Lanes whose box touches the tile. The box of the other lanes may be saturated, because it is too far away.
HWY_INLINE uint64_t LanesNear(const Batch& batch, const VoxelRange& tile) {
  uint64_t near = ~uint64_t{0};
  for (int a = 0; a < 3; ++a) {
    near &=
        Bits(DI(), hn::And(AtMost(batch.first[a], SetI(tile.end[a] - 1)), AtMost(SetI(tile.begin[a]), batch.last[a])));
  }
  return near;
}

// The boxes of `lanes`, cut to the tile.
HWY_INLINE void AddBoxes(const Batch& batch, uint64_t lanes, const VoxelRange& tile, int triangle, TileSpans& out) {
  HWY_ALIGN int32_t first[3][kLanes], last[3][kLanes];
  for (int a = 0; a < 3; ++a) {
    hn::Store(hn::Max(batch.first[a], SetI(tile.begin[a])), DI(), first[a]);
    hn::Store(hn::Min(batch.last[a], SetI(tile.end[a] - 1)), DI(), last[a]);
  }
  for (; lanes != 0; lanes &= lanes - 1) {
    const int k = std::countr_zero(lanes);
    for (int64_t z = first[2][k]; z <= last[2][k]; ++z) {
      for (int64_t y = first[1][k]; y <= last[1][k]; ++y) {
        out.Add(triangle + k, (y - tile.begin[1]) + TileDim(1) * (z - tile.begin[2]), first[0][k] - tile.begin[0],
                last[0][k] - tile.begin[0]);
      }
    }
  }
}

// The rows of the lanes of `active`, all of them narrow and near: RasterBatch for a tile instead of a slab.
HWY_INLINE void AddRows(const Batch& batch, MF active, const VoxelRange& tile, int triangle, TileSpans& out) {
  const DF df;
  const DI di;
  const BoundsF& b = batch.bounds;
  const VI z_begin = SetI(tile.begin[2]);
  const VI z_first = hn::Max(batch.first[2], z_begin), z_last = hn::Min(batch.last[2], SetI(tile.end[2] - 1));
  const VI y_least = SetI(tile.begin[1]), y_most = SetI(tile.end[1] - 1);
  const VI x_least = SetI(tile.begin[0]), x_most = SetI(tile.end[0] - 1);
  const int32_t layers = MaxWhere(active, hn::Sub(z_last, z_first), -1);
  HWY_ALIGN uint32_t spans[kLanes];
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
    y_begin = hn::Max(y_begin, y_least);
    y_end = hn::Min(y_end, y_most);
    const MF in_layer = hn::And(active, hn::RebindMask(df, AtMost(z, z_last)));
    const VI z_row = hn::ShiftLeft<3>(hn::Sub(z, z_begin));
    const int32_t rows = MaxWhere(in_layer, hn::Sub(y_end, y_begin), -1);
    for (int32_t j = 0; j <= rows; ++j) {
      const VI y = hn::Add(y_begin, SetI(j));
      const VF y_local = hn::ConvertTo(df, hn::Sub(y, batch.base[1]));
      VF first = x_first, last = x_last;
      for (int i = 0; i < 3; ++i) Tighten(b.x_of_y[i], y_local, first, last);
      const VF shift = hn::Mul(b.plane_sy, y_local);
      first = hn::Max(first, hn::Sub(plane_lo, shift));
      last = hn::Min(last, hn::Sub(plane_hi, shift));
      VI x_begin, x_end;
      ToGrid(first, last, b.first.x, b.last.x, batch.base[0], x_begin, x_end);
      x_begin = hn::Max(x_begin, x_least);
      x_end = hn::Min(x_end, x_most);
      const auto hit = hn::And(hn::RebindMask(di, in_layer), hn::And(AtMost(y, y_end), AtMost(x_begin, x_end)));
      uint64_t lanes = Bits(di, hit);
      if (lanes == 0) continue;
      const VI row = hn::Add(hn::Sub(y, y_least), z_row);
      const VI x = hn::Or(hn::ShiftLeft<8>(hn::Sub(x_begin, x_least)), hn::ShiftLeft<16>(hn::Sub(x_end, x_least)));
      const hn::RebindToUnsigned<DI> du;
      hn::Store(hn::BitCast(du, hn::Or(row, x)), du, spans);
      for (; lanes != 0; lanes &= lanes - 1) {
        const int lane = std::countr_zero(lanes);
        out.spans[triangle + lane][out.count[triangle + lane]++].bits = spans[lane];
      }
    }
  }
}

// AddTileSpans for a triangle of the wide class: the rows of a layer are lanes.
HWY_INLINE void AddWideRows(const TriangleSetup& setup, const VoxelRange& tile, int triangle, TileSpans& out) {
  const VoxelRange range = ClipToRange(setup, tile);
  if (range.empty()) return;
  const DD d;
  const SpanBounds<double>& s = setup.wide;
  const double y_lo = double(range.begin[1]), y_hi = double(range.end[1]), x_tile = double(tile.begin[0]);
  const VD x_lo = SetD(double(range.begin[0])), x_hi = SetD(double(range.end[0])), x_base = SetD(setup.base.x);
  HWY_ALIGN int32_t spans[kHalf];
  for (int64_t z = range.begin[2]; z < range.end[2]; ++z) {
    const Layer<double> layer = ComputeLayer(s, double(z) - setup.base.z);
    if (layer.y.empty() || layer.x.empty()) continue;
    const auto y_begin = int64_t(Clamp(setup.base.y + layer.y.first, y_lo, y_hi));
    const auto y_end = int64_t(Clamp((setup.base.y + layer.y.last) + 1, y_lo, y_hi));
    for (int64_t y0 = y_begin; y0 < y_end; y0 += kHalf) {
      const VD y = hn::Add(SetD(double(y0) - setup.base.y), hn::Iota(d, 0.0));
      VD first = SetD(layer.x.first), last = SetD(layer.x.last);
      for (int i = 0; i < 3; ++i) {
        const VD shift = hn::Mul(SetD(s.x_of_y[i].s), y);
        first = hn::Max(first, hn::Sub(SetD(s.x_of_y[i].lo), shift));
        last = hn::Min(last, hn::Sub(SetD(s.x_of_y[i].hi), shift));
      }
      const VD shift = hn::Mul(SetD(s.plane_sy), y);
      first = hn::Ceil(hn::Max(first, hn::Sub(SetD(layer.plane_lo), shift)));
      last = hn::Floor(hn::Min(last, hn::Sub(SetD(layer.plane_hi), shift)));
      const VD begin = hn::Min(hn::Max(hn::Add(x_base, first), x_lo), x_hi);
      const VD end = hn::Min(hn::Max(hn::Add(hn::Add(x_base, last), SetD(1)), x_lo), x_hi);
      const auto row = double((y0 - tile.begin[1]) + TileDim(1) * (z - tile.begin[2]));
      const VD at = hn::Add(hn::Add(SetD(row), hn::Iota(d, 0.0)),  // a TileSpan; all are whole numbers
                            hn::Add(hn::Mul(hn::Sub(begin, SetD(x_tile)), SetD(0x1p8)),
                                    hn::Mul(hn::Sub(end, SetD(x_tile + 1)), SetD(0x1p16))));
      hn::Store(hn::DemoteTo(hn::Half<DI>(), at), hn::Half<DI>(), spans);
      const uint64_t rows = (uint64_t{1} << std::min<int64_t>(kHalf, y_end - y0)) - 1;
      for (uint64_t left = rows & Bits(d, hn::Lt(begin, end)); left != 0; left &= left - 1) {
        out.spans[triangle][out.count[triangle]++].bits = uint32_t(spans[std::countr_zero(left)]);
      }
    }
  }
}

template <Coverage kCoverage>
HWY_ATTR void SpansInTileAs(const RowMesh& mesh, const uint64_t* pairs, int64_t count, const VoxelRange& tile,
                            TileSpans& out) {
  const Divisor divisors[3] = {Divisor(mesh.space.voxel_size.x), Divisor(mesh.space.voxel_size.y),
                               Divisor(mesh.space.voxel_size.z)};
  uint32_t ids[kLanes];
  std::fill_n(out.count, TileSpans::kTriangles, 0);
  for (int64_t i = 0; i < count; i += kLanes) {
    const int64_t here = std::min<int64_t>(kLanes, count - i);
    for (int64_t k = 0; k < kLanes; ++k) ids[k] = uint32_t(pairs[i + std::min(k, here - 1)]);
    Batch batch;
    SetUpBatch<kCoverage>(mesh, divisors, ids, batch);
    const uint64_t used = here == kLanes ? (uint64_t{1} << kLanes) - 1 : (uint64_t{1} << here) - 1;
    const uint64_t runs = used & RunLanes<kCoverage>(batch);
    const uint64_t narrow = used & ~runs & Bits(DF(), batch.narrow), near = LanesNear(batch, tile);
    const auto first_lane = int(i);
    if ((runs & near) != 0) AddBoxes(batch, runs & near, tile, first_lane, out);
    if (const uint64_t lanes = narrow & near; lanes != 0) {
      const uint8_t bytes[8] = {uint8_t(lanes), uint8_t(lanes >> 8)};
      AddRows(batch, hn::LoadMaskBits(DF(), bytes), tile, first_lane, out);
    }
    for (uint64_t left = used & ~runs & ~narrow; left != 0; left &= left - 1) {
      const int k = std::countr_zero(left);
      const uint32_t* v = mesh.triangles[ids[k]];
      const TriangleSetup setup =
          SetUpTriangle(mesh.positions[v[0]], mesh.positions[v[1]], mesh.positions[v[2]], kCoverage);
      if (setup.span_class == SpanClass::kWide) {
        AddWideRows(setup, tile, first_lane + k, out);
      } else {
        AddTileSpans(setup, tile, first_lane + k, out);
      }
    }
  }
}

HWY_ATTR void SpansInTile(const RowMesh& mesh, const uint64_t* pairs, int64_t count, Coverage coverage,
                          const VoxelRange& tile, TileSpans& out) {
  switch (coverage) {
    case Coverage::kConservative: return SpansInTileAs<Coverage::kConservative>(mesh, pairs, count, tile, out);
    case Coverage::kThin: return SpansInTileAs<Coverage::kThin>(mesh, pairs, count, tile, out);
    case Coverage::kCenter: return SpansInTileAs<Coverage::kCenter>(mesh, pairs, count, tile, out);
    case Coverage::kNone: std::fill_n(out.count, TileSpans::kTriangles, 0);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace voxelpipe::cpu
HWY_AFTER_NAMESPACE();

#endif  // HWY_TARGET
#endif  // include guard
