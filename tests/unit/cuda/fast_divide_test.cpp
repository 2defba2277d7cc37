#include "cuda/primitives/fast_divide.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>

namespace voxelpipe::cuda {
namespace {

// Where a product could be too large by one: before and at multiples of the divisor.
void ExpectQuotients(uint32_t divisor) {
  constexpr uint32_t kEnd = 1 << 30;
  const Divisor by = MakeDivisor(divisor);
  const uint64_t multiples = kEnd / divisor;
  for (uint64_t i = 0; i <= 2000; ++i) {
    const uint64_t multiple = multiples * i / 2000 * divisor;
    for (const uint64_t n :
         {multiple - std::min<uint64_t>(multiple, 1), multiple, multiple + 1, multiple + divisor - 1}) {
      if (n >= kEnd) continue;
      ASSERT_EQ(Quotient(uint32_t(n), by), n / divisor) << n << " / " << divisor;
    }
  }
  ASSERT_EQ(Quotient(kEnd - 1, by), (kEnd - 1) / divisor) << divisor;
}

TEST(Divisor, GivesTheQuotient) {
  for (uint32_t divisor = 1; divisor <= 2050; ++divisor) ExpectQuotients(divisor);
  for (int log = 11; log <= 31; ++log) {
    const uint32_t power = uint32_t{1} << log;
    for (const uint32_t divisor : {power - 1, power, log < 31 ? power + 1 : power}) ExpectQuotients(divisor);
  }
}

}  // namespace
}  // namespace voxelpipe::cuda
