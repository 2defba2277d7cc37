// ISA-L selects the instruction set at run time. Its caller does the inversions at both ends.
#include "base/checksum/crc32c.h"

#include <isa-l/crc.h>

#include <algorithm>

namespace voxelpipe {

uint32_t Crc32c(std::span<const uint8_t> bytes) {
  return ExtendCrc32c(0, bytes);
}

uint32_t ExtendCrc32c(uint32_t crc, std::span<const uint8_t> bytes) {
  constexpr size_t kMaxStepBytes = size_t{1} << 30;  // the library takes the length as an int
  crc = ~crc;
  while (!bytes.empty()) {
    const size_t n = std::min(bytes.size(), kMaxStepBytes);
    // The parameter is not const, but the bytes are only read.
    crc = crc32_iscsi(const_cast<unsigned char*>(bytes.data()), int(n), crc);
    bytes = bytes.subspan(n);
  }
  return ~crc;
}

}  // namespace voxelpipe
