// Textures and colours of materials on vectors: shaders/texture/texture.h, shaders/fragment/material.h and the uv
// density of fragment_input.h, operation by operation. Included once for each instruction set; no include guard but
// Highway's.
#if defined(VOXELPIPE_TEXTURE_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef VOXELPIPE_TEXTURE_LANES_INL_H_
#undef VOXELPIPE_TEXTURE_LANES_INL_H_
#else
#define VOXELPIPE_TEXTURE_LANES_INL_H_
#endif

#include <array>

#include "cpu/shading/vertex_lanes-inl.h"
#include "mesh/views/mips.h"
#include "shaders/texture/srgb.h"

#if HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3

HWY_BEFORE_NAMESPACE();
namespace voxelpipe::cpu {
namespace HWY_NAMESPACE {

struct Color {
  VHF r, g, b, a;
};
HWY_INLINE Color SetColor(const Vec4f& v) {
  return {SetHF(v.x), SetHF(v.y), SetHF(v.z), SetHF(v.w)};
}
HWY_INLINE Color Times(const Color& a, const Color& b) {
  return {hn::Mul(a.r, b.r), hn::Mul(a.g, b.g), hn::Mul(a.b, b.b), hn::Mul(a.a, b.a)};
}
HWY_INLINE VHF LerpLanes(VHF a, VHF b, VHF t) {
  return hn::Add(a, hn::Mul(hn::Sub(b, a), t));
}
HWY_INLINE Color LerpColor(const Color& a, const Color& b, VHF t) {
  return {LerpLanes(a.r, b.r, t), LerpLanes(a.g, b.g, t), LerpLanes(a.b, b.b, t), LerpLanes(a.a, b.a, t)};
}
HWY_INLINE Color Select(hn::Mask<DHF> mask, const Color& yes, const Color& no) {
  return {hn::IfThenElse(mask, yes.r, no.r), hn::IfThenElse(mask, yes.g, no.g), hn::IfThenElse(mask, yes.b, no.b),
          hn::IfThenElse(mask, yes.a, no.a)};
}

// SrgbToLinear of all codes, and code / 255.
struct ChannelTables {
  HWY_ALIGN float srgb[256], linear[256];
  ChannelTables() {
    for (int code = 0; code < 256; ++code) {
      srgb[code] = SrgbToLinear(static_cast<unsigned char>(code));
      linear[code] = float(code) / 255.0f;
    }
  }
};
inline const ChannelTables& Channels() {
  static const ChannelTables tables;
  return tables;
}

// A texture whose samples are bilinear.
class Sampler {
 public:
  static constexpr uint32_t kMaxLevels = 32;

  explicit Sampler(const TextureView& texture) : texture_(texture), tables_(Channels()) {
    const bool mips = texture.mips != nullptr && texture.mip_filter != kNone;
    last_ = mips ? int32_t(texture.levels) - 1 : 0;
    for (uint32_t level = 0; level <= uint32_t(last_); ++level) {
      width_[level] = int32_t(LevelEdge(texture.width, level));
      height_[level] = int32_t(LevelEdge(texture.height, level));
      offset_[level] = level == 0 ? 0 : int32_t(LevelOffset(texture.width, texture.height, level));
    }
  }

  // True if texels are addressed by 32-bit lanes and no sample takes the nearest texel.
  static bool Fits(const TextureView& texture) {
    return !texture.nearest && !texture.min_nearest && texture.levels <= kMaxLevels &&
           uint64_t{texture.width} * texture.height < (uint64_t{1} << 28);
  }

  // SampleTexture.
  HWY_INLINE Color Sample(VHF u, VHF v, VHF texels_per_voxel) const {
    const DHF df;
    const DHI di;
    const auto minified = hn::Gt(texels_per_voxel, SetHF(1));
    if (last_ == 0 || hn::AllFalse(df, minified)) return SampleLevel(hn::Zero(di), u, v);
    // The exponent is the level: halving is exact.
    const VHI bits = hn::BitCast(di, texels_per_voxel);
    const VHI last = hn::Set(di, last_);
    const VHI exponent = hn::Sub(hn::ShiftRight<23>(bits), hn::Set(di, 127));
    const auto minified_i = hn::RebindMask(di, minified);
    VHI level = hn::IfThenElseZero(minified_i, hn::Min(exponent, last));
    const auto between = hn::RebindMask(df, hn::And(minified_i, hn::Lt(level, last)));
    const VHF rest = hn::BitCast(df, hn::Sub(bits, hn::ShiftLeft<23>(level)));
    if (texture_.mip_filter == kNearest) {
      const auto coarser = hn::AndNot(hn::Lt(hn::Mul(rest, rest), SetHF(2)), between);
      level = hn::Sub(level, hn::VecFromMask(di, hn::RebindMask(di, coarser)));
      return SampleLevel(level, u, v);
    }
    const Color fine = SampleLevel(level, u, v);
    if (hn::AllFalse(df, between)) return fine;
    const VHI next = hn::Min(hn::Add(level, hn::Set(di, 1)), last);
    return Select(between, LerpColor(fine, SampleLevel(next, u, v), hn::Sub(rest, SetHF(1))), fine);
  }

 private:
  static constexpr uint8_t kNone = 0, kNearest = 1;     // MipFilter
  static constexpr uint8_t kRepeat = 0, kMirrored = 1;  // WrapMode

  // WrapTexel. Whole numbers below 2^41.
  HWY_INLINE static VD Wrap(VD i, VD size, uint8_t mode) {
    const DD d;
    const VD zero = hn::Zero(d), one = hn::Set(d, 1.0);
    const MD inside = hn::And(hn::Ge(i, zero), hn::Lt(i, size));
    if (HWY_LIKELY(hn::AllTrue(d, inside))) return i;
    if (mode != kRepeat && mode != kMirrored) return hn::Min(hn::Max(i, zero), hn::Sub(size, one));
    const VD period = mode == kMirrored ? hn::Add(size, size) : size;
    // Exact: a quotient below 2^41 that is no whole number is at least 2^-29 from one.
    const VD r = hn::Sub(i, hn::Mul(period, hn::Floor(hn::Div(i, period))));
    const VD back = hn::Sub(hn::Sub(period, one), r);
    return hn::IfThenElse(inside, i, hn::IfThenElse(hn::Lt(r, size), r, back));
  }

  // Of one axis: the two texels, and the weight of the second.
  struct Axis {
    VD first, second;
    VHF weight;
  };
  HWY_INLINE static Axis AxisAt(VHF coordinate, VD size, uint8_t mode) {
    const DD d;
    VD at = hn::Mul(hn::PromoteTo(d, coordinate), size);
    at = hn::IfThenElseZero(hn::Lt(hn::Abs(at), hn::Set(d, 0x1p40)), at);
    at = hn::Sub(at, hn::Set(d, 0.5));
    const VD whole = hn::Floor(at);
    return {Wrap(whole, size, mode), Wrap(hn::Add(whole, hn::Set(d, 1.0)), size, mode),
            hn::DemoteTo(DHF(), hn::Sub(at, whole))};
  }

  // DecodeTexel of texels of level 0.
  HWY_INLINE Color Decode(VHI texel) const {
    const DHF df;
    const DHI di;
    const float* const table = texture_.srgb ? tables_.srgb : tables_.linear;
    const VHI low = hn::Set(di, 0xff);
    const VHI bits = hn::GatherIndex(di, reinterpret_cast<const int32_t*>(texture_.rgba), texel);
    const hn::RebindToUnsigned<DHI> du;
    const VHI alpha = hn::BitCast(di, hn::ShiftRight<24>(hn::BitCast(du, bits)));
    return {hn::GatherIndex(df, table, hn::And(bits, low)),
            hn::GatherIndex(df, table, hn::And(hn::ShiftRight<8>(bits), low)),
            hn::GatherIndex(df, table, hn::And(hn::ShiftRight<16>(bits), low)),
            hn::GatherIndex(df, tables_.linear, alpha)};
  }
  HWY_INLINE Color OfMips(VHI texel) const {
    const DHF df;
    const auto floats = reinterpret_cast<const float*>(texture_.mips);
    const VHI at = hn::ShiftLeft<2>(texel);
    return {hn::GatherIndex(df, floats, at), hn::GatherIndex(df, floats + 1, at), hn::GatherIndex(df, floats + 2, at),
            hn::GatherIndex(df, floats + 3, at)};
  }

  // Levels of a vector: where their texels begin, and which are level 0.
  struct Levels {
    VD width;
    VHI offset;
    hn::Mask<DHF> full;
    bool all_full, none_full;
  };
  HWY_INLINE Color Fetch(const Levels& levels, VD x, VD y) const {
    const DHI di;
    const VHI at = hn::DemoteTo(di, hn::Add(hn::Mul(y, levels.width), x));
    if (levels.all_full) return Decode(at);
    const VHI in_mips = hn::Add(at, levels.offset);
    if (levels.none_full) return OfMips(in_mips);
    const auto full = hn::RebindMask(di, levels.full);
    return Select(levels.full, Decode(hn::IfThenElseZero(full, at)), OfMips(hn::IfThenZeroElse(full, in_mips)));
  }

  // SampleLevel, bilinear.
  HWY_INLINE Color SampleLevel(VHI level, VHF u, VHF v) const {
    const DD d;
    const DHI di;
    const DHF df;
    const VD width = hn::PromoteTo(d, hn::GatherIndex(di, width_, level));
    const VD height = hn::PromoteTo(d, hn::GatherIndex(di, height_, level));
    const auto full = hn::RebindMask(df, hn::Eq(level, hn::Zero(di)));
    const Levels levels{width, hn::GatherIndex(di, offset_, level), full, hn::AllTrue(df, full),
                        hn::AllFalse(df, full)};
    const Axis x = AxisAt(u, width, texture_.wrap_s), y = AxisAt(v, height, texture_.wrap_t);
    const Color top = LerpColor(Fetch(levels, x.first, y.first), Fetch(levels, x.second, y.first), x.weight);
    const Color bottom = LerpColor(Fetch(levels, x.first, y.second), Fetch(levels, x.second, y.second), x.weight);
    return LerpColor(top, bottom, y.weight);
  }

  const TextureView& texture_;
  const ChannelTables& tables_;
  int32_t last_ = 0;  // level
  HWY_ALIGN int32_t width_[kMaxLevels], height_[kMaxLevels], offset_[kMaxLevels];
};

// UvDensity of the batch's triangles, 0 for degenerate ones.
HWY_INLINE void UvDensities(const FragmentBatch& batch, int set, float* densities) {
  const DD d;
  const DHF df;
  const DHI di;
  const auto uv = reinterpret_cast<const float*>(batch.mesh->uv[set]);
  for (int t = 0; t < batch.triangles; t += kHalf) {
    Vec3D p[3];
    VD u[3], v[3];
    for (int k = 0; k < 3; ++k) {
      const VHI vertex = hn::Load(di, batch.vertex[k] + t);
      p[k] = GatherVec3d(batch.mesh->index_positions, vertex);
      const VHI at = hn::Add(vertex, vertex);
      u[k] = hn::PromoteTo(d, hn::GatherIndex(df, uv, at));
      v[k] = hn::PromoteTo(d, hn::GatherIndex(df, uv + 1, at));
    }
    const Vec3D n = Cross3(p[1] - p[0], p[2] - p[0]);
    const VD area = hn::Sqrt(Dot3(n, n));
    const VD du1 = hn::Sub(u[1], u[0]), dv1 = hn::Sub(v[1], v[0]);
    const VD du2 = hn::Sub(u[2], u[0]), dv2 = hn::Sub(v[2], v[0]);
    const VD uv_area = hn::Abs(hn::Sub(hn::Mul(du1, dv2), hn::Mul(du2, dv1)));
    const VD zero = hn::Zero(d), most = hn::Set(d, 0x1p60);
    const MD valid = hn::And(hn::Gt(area, zero), hn::Gt(uv_area, zero));
    VD density = hn::IfThenElseZero(valid, hn::Sqrt(hn::Div(uv_area, area)));
    density = hn::IfThenElse(hn::Ge(density, most), most, density);
    density = hn::IfThenElseZero(hn::Eq(density, density), density);
    const auto degenerate =
        hn::RebindMask(df, hn::MaskFromVec(hn::Load(di, reinterpret_cast<const int32_t*>(batch.degenerate) + t)));
    hn::Store(hn::IfThenZeroElse(degenerate, hn::DemoteTo(df, density)), df, densities + t);
  }
}

// SampleMaterial: one texture of the batch's material.
class MaterialSampler {
 public:
  MaterialSampler(const FragmentBatch& batch, const TextureRefView& ref) : batch_(batch), ref_(ref) {
    white_ = ref.texture < 0 || !batch.part->has_uv[ref.uv_set] || TextureOf(batch, ref).width == 0;
    if (white_) return;
    sampler_.emplace(TextureOf(batch, ref));
    UvDensities(batch, ref.uv_set, densities_);
  }

  static bool Fits(const FragmentBatch& batch, const TextureRefView& ref) {
    return ref.texture < 0 || Sampler::Fits(TextureOf(batch, ref));
  }

  HWY_INLINE Color Sample(const Fragments& in) const {
    if (white_) return SetColor({1, 1, 1, 1});
    const void* const uv = batch_.mesh->uv[ref_.uv_set];
    const VHF u = Interpolated<2>(in, uv, 0), v = Interpolated<2>(in, uv, 1);
    const auto moved = [&](const float(&m)[3]) HWY_ATTR {
      return hn::Add(hn::Add(hn::Mul(SetHF(m[0]), u), hn::Mul(SetHF(m[1]), v)), SetHF(m[2]));
    };
    const VHF density = hn::GatherIndex(DHF(), densities_, in.triangle);
    return sampler_->Sample(moved(ref_.m[0]), moved(ref_.m[1]), hn::Mul(density, SetHF(ref_.texels)));
  }

 private:
  static const TextureView& TextureOf(const FragmentBatch& batch, const TextureRefView& ref) {
    return batch.mesh->textures[ref.texture];
  }

  const FragmentBatch& batch_;
  const TextureRefView& ref_;
  bool white_;
  std::optional<Sampler> sampler_;
  HWY_ALIGN float densities_[kBatchFragments];
};

// BaseColor of a batch.
class BaseColorLanes {
 public:
  BaseColorLanes(const FragmentBatch& batch, const MaterialView& material)
      : batch_(batch), material_(material), texture_(batch, material.base_color) {}

  HWY_INLINE Color At(const Fragments& in) const {
    const Color color = Times(SetColor(material_.base_color_factor), texture_.Sample(in));
    if (!batch_.part->has_colors) return color;
    const void* const colors = batch_.mesh->colors;
    return Times(color, {Interpolated<4>(in, colors, 0), Interpolated<4>(in, colors, 1), Interpolated<4>(in, colors, 2),
                         Interpolated<4>(in, colors, 3)});
  }
  // What alpha mode MASK discards of a material that has it.
  HWY_INLINE void StoreDiscard(VHF alpha, int at, ShadedBatch& out) const {
    const DHI di;
    const auto masked = hn::Lt(alpha, SetHF(material_.alpha_cutoff));
    hn::Store(hn::VecFromMask(di, hn::RebindMask(di, masked)), di, reinterpret_cast<int32_t*>(out.discard) + at);
  }

 private:
  const FragmentBatch& batch_;
  const MaterialView& material_;
  MaterialSampler texture_;
};

HWY_ATTR void ShadeBaseColor(const FragmentBatch& batch, const MaterialView& material, ShadedBatch& out) {
  const BaseColorLanes base_color(batch, material);
  if (!material.alpha_mask) KeepAll(batch, out);
  for (int i = 0; i < batch.count; i += kHalf) {
    const Color color = base_color.At(FragmentsAt(batch, i));
    StoreOutput(out, i, color.r, color.g, color.b, color.a);
    if (material.alpha_mask) base_color.StoreDiscard(color.a, i, out);
  }
}

// What alpha mode MASK discards of the fragments of a shader that reads the material, but not its base colour.
HWY_ATTR void MaskBatch(const FragmentBatch& batch, const MaterialView& material, ShadedBatch& out) {
  if (!material.alpha_mask) return KeepAll(batch, out);
  const BaseColorLanes base_color(batch, material);
  for (int i = 0; i < batch.count; i += kHalf) base_color.StoreDiscard(base_color.At(FragmentsAt(batch, i)).a, i, out);
}

HWY_ATTR void ShadeEmissive(const FragmentBatch& batch, const MaterialView& material, ShadedBatch& out) {
  const MaterialSampler texture(batch, material.emissive);
  const Vec3f& factor = material.emissive_factor;
  for (int i = 0; i < batch.count; i += kHalf) {
    const Color texel = texture.Sample(FragmentsAt(batch, i));
    StoreOutput(out, i, hn::Mul(SetHF(factor.x), texel.r), hn::Mul(SetHF(factor.y), texel.g),
                hn::Mul(SetHF(factor.z), texel.b), SetHF(1));
  }
  MaskBatch(batch, material, out);
}

HWY_ATTR void ShadeMetallicRoughness(const FragmentBatch& batch, const MaterialView& material, ShadedBatch& out) {
  const MaterialSampler texture(batch, material.metallic_roughness);
  for (int i = 0; i < batch.count; i += kHalf) {
    const Color texel = texture.Sample(FragmentsAt(batch, i));
    StoreOutput(out, i, hn::Mul(SetHF(material.metallic_factor), texel.b),
                hn::Mul(SetHF(material.roughness_factor), texel.g), hn::Zero(DHF()), SetHF(1));
  }
  MaskBatch(batch, material, out);
}

}  // namespace HWY_NAMESPACE
}  // namespace voxelpipe::cpu
HWY_AFTER_NAMESPACE();

#endif  // HWY_TARGET
#endif  // include guard
