// The vector kernels. Null if the compiler does not support them.
#pragma once

#include "cpu/rows/row_kernels.h"

namespace voxelpipe::cpu {

const RowKernels* Avx2RowKernels();
const RowKernels* Avx512RowKernels();

}  // namespace voxelpipe::cpu
