// Compiles row_kernels-inl.h for each instruction set, by Google Highway's foreach_target.h.
#include "cpu/rows/row_kernels_simd.h"

// AVX2 and AVX-512 have a gather and a fused multiply-add; processors without them use the scalar kernels. Highway
// requires a fallback target too (emulated or scalar), which is never called.
#undef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (~(HWY_AVX3 | HWY_AVX2 | HWY_EMU128 | HWY_SCALAR))
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "cpu/rows/row_kernels_simd.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.h, which includes this file again for each target.
#include <hwy/highway.h>

#include "cpu/rows/row_kernels-inl.h"
// After it, whose set-up they use.
#include "cpu/rows/crossing_kernels-inl.h"
#include "cpu/rows/tile_kernels-inl.h"

#if HWY_ONCE
namespace voxelpipe::cpu {

const RowKernels* Avx2RowKernels() {
#if (HWY_TARGETS & HWY_AVX2)
  static constexpr RowKernels kKernels{"avx2",
                                       N_AVX2::Place,
                                       N_AVX2::Scan,
                                       N_AVX2::RasterSmall,
                                       N_AVX2::RasterLarge,
                                       N_AVX2::TileBoxes,
                                       N_AVX2::SpansInTile,
                                       N_AVX2::CrossSmall,
                                       N_AVX2::CrossLarge,
                                       N_AVX2::SpreadToggles};
  return &kKernels;
#else
  return nullptr;
#endif
}

const RowKernels* Avx512RowKernels() {
#if (HWY_TARGETS & HWY_AVX3)
  static constexpr RowKernels kKernels{
      "avx512",          N_AVX3::Place,       N_AVX3::Scan,       N_AVX3::RasterSmall, N_AVX3::RasterLarge,
      N_AVX3::TileBoxes, N_AVX3::SpansInTile, N_AVX3::CrossSmall, N_AVX3::CrossLarge,  N_AVX3::SpreadToggles};
  return &kKernels;
#else
  return nullptr;
#endif
}

}  // namespace voxelpipe::cpu
#endif  // HWY_ONCE
