// The vector kernels. Null if the compiler does not support them.
#pragma once

#include "cpu/shading/shade_kernels.h"

namespace voxelpipe::cpu {

const ShadeKernels* Avx2ShadeKernels();
const ShadeKernels* Avx512ShadeKernels();

}  // namespace voxelpipe::cpu
