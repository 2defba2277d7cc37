// Shader outputs to what targets keep, on vectors: ToCell and ToTerm of shaders/blend_ops.h, operation by operation,
// for f32 outputs. Other formats are converted one by one. Included once for each instruction set; no include guard but
// Highway's.
#if defined(VOXELPIPE_CONVERT_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef VOXELPIPE_CONVERT_LANES_INL_H_
#undef VOXELPIPE_CONVERT_LANES_INL_H_
#else
#define VOXELPIPE_CONVERT_LANES_INL_H_
#endif

#include "cpu/shading/place_lanes-inl.h"
#include "cpu/shading/shade_kernels.h"
#include "shaders/blend_ops.h"

#if HWY_TARGET == HWY_AVX2 || HWY_TARGET == HWY_AVX3

HWY_BEFORE_NAMESPACE();
namespace voxelpipe::cpu {
namespace HWY_NAMESPACE {

// ToF32: NaN becomes 0.
HWY_INLINE VHF WithoutNan(VHF v) {
  return hn::IfThenElseZero(hn::Eq(v, v), v);
}

// ToUnsigned of integers that a signed lane holds.
HWY_INLINE VHI ToUnsignedLanes(VD v, double most) {
  const DD d;
  const VD magic = hn::Set(d, 0x1.8p52), limit = hn::Set(d, most);
  const VD rounded = hn::Sub(hn::Add(hn::IfThenElse(hn::Ge(v, limit), limit, v), magic), magic);
  return hn::DemoteTo(DHI(), hn::IfThenElseZero(hn::Gt(v, hn::Zero(d)), rounded));
}

HWY_ATTR void ToCells(const ShadedBatch& shaded, int count, const ConversionRules& rules, BatchCells& cells) {
  const DD d;
  const DHF df;
  const DHI di;
  const bool is_f32 = rules.format == VoxelFormat::kF32;
  const bool is_small = rules.format == VoxelFormat::kU8 || rules.format == VoxelFormat::kU16;
  if (rules.is_u32 || !(is_f32 || is_small)) return ToCellsOneByOne(shaded, count, rules, cells);
  const VD scale = hn::Set(d, rules.scale);
  const double most = double(LargestInteger(rules.format));
  for (int c = 0; c < rules.components; ++c) {
    const auto out = reinterpret_cast<int32_t*>(cells[c]);
    for (int i = 0; i < count; i += kHalf) {
      const VHF v = hn::Load(df, shaded.f[c] + i);
      if (is_f32) {
        hn::Store(hn::BitCast(di, WithoutNan(v)), di, out + i);
      } else {
        hn::Store(ToUnsignedLanes(hn::Mul(hn::PromoteTo(d, v), scale), most), di, out + i);
      }
    }
  }
}

HWY_ATTR void ToTerms(const ShadedBatch& shaded, int count, const ConversionRules& rules, BatchTerms& terms) {
  const DD d;
  const DHF df;
  const DL dl;
  const bool is_small = rules.format == VoxelFormat::kU8 || rules.format == VoxelFormat::kU16;
  if (rules.is_u32 || !(is_small || SumsFloats(rules.format))) return ToTermsOneByOne(shaded, count, rules, terms);
  const VD scale = hn::Set(d, rules.scale), quantum = hn::Set(d, rules.quantum);
  const VD magic = hn::Set(d, 0x1.8p52), least = hn::Set(d, -0x1p40), largest = hn::Set(d, 0x1p40);
  const double most = double(LargestInteger(rules.format));
  for (int c = 0; c < rules.components; ++c) {
    for (int i = 0; i < count; i += kHalf) {
      const VHF v = hn::Load(df, shaded.f[c] + i);
      if (is_small) {
        hn::Store(hn::PromoteTo(dl, ToUnsignedLanes(hn::Mul(hn::PromoteTo(d, v), scale), most)), dl, terms[c] + i);
        continue;
      }
      // Quantize. The bits of a number near the magic one count its distance from it.
      const VD scaled = hn::Div(hn::PromoteTo(d, WithoutNan(v)), quantum);
      const VD clamped = hn::Min(hn::Max(scaled, least), largest);
      hn::Store(hn::Sub(hn::BitCast(dl, hn::Add(clamped, magic)), hn::BitCast(dl, magic)), dl, terms[c] + i);
    }
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace voxelpipe::cpu
HWY_AFTER_NAMESPACE();

#endif  // HWY_TARGET
#endif  // include guard
