// Division by a divisor known on the host, as a multiplication and a shift (T. Granlund and P. L. Montgomery, "Division
// by Invariant Integers using Multiplication", PLDI 1994). No host-only includes.
#pragma once

#include <cstdint>

#include "base/host_device.h"

namespace voxelpipe::cuda {

struct Divisor {
  uint32_t divisor = 1;
  uint32_t factor = (uint32_t{1} << 31) + 1;
  int shift = 31;
};

// `divisor`: 1 to 2^31.
inline Divisor MakeDivisor(uint32_t divisor) {
  int log = 0;
  while (divisor >> log > 1) ++log;
  return {divisor, uint32_t((uint64_t{1} << (31 + log)) / divisor + 1), 31 + log};
}

// n / divisor for n below 2^30: the product is too large by at most n / 2^shift, which is less than 1 / divisor.
VOXELPIPE_HD uint32_t Quotient(uint32_t n, const Divisor& by) {
  return uint32_t(uint64_t{n} * by.factor >> by.shift);
}

}  // namespace voxelpipe::cuda
