// Vector types of the row kernels, and the lanes of a mask as bits. Included once for each instruction set; no include
// guard but Highway's.
#if defined(VOXELPIPE_ROW_LANES_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef VOXELPIPE_ROW_LANES_INL_H_
#undef VOXELPIPE_ROW_LANES_INL_H_
#else
#define VOXELPIPE_ROW_LANES_INL_H_
#endif

#include <hwy/highway.h>

#include <cstring>

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
constexpr int64_t kNearWords = 1 << 22;                  // 16 MiB of bits: no prefetch up to this size

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

}  // namespace HWY_NAMESPACE
}  // namespace voxelpipe::cpu
HWY_AFTER_NAMESPACE();

#endif  // HWY_TARGET
#endif  // include guard
