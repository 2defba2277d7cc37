// The checksum of ZIP archives.
#pragma once

#include <cstdint>
#include <span>

namespace voxelpipe {

// Extends `crc`, a CRC-32 (ISO 3309, as in ZIP and PNG), by `bytes`. Starts with 0. "123456789" gives 0xCBF43926.
uint32_t Crc32(uint32_t crc, std::span<const uint8_t> bytes);

}  // namespace voxelpipe
