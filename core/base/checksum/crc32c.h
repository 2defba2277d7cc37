// The checksum that every piece of a streamed result carries.
#pragma once

#include <cstdint>
#include <span>

namespace voxelpipe {

// CRC-32C (Castagnoli): reflected, initial value and final xor of all ones; "123456789" gives 0xE3069283.
uint32_t Crc32c(std::span<const uint8_t> bytes);
// Extends `crc`, the CRC-32C of the bytes before, by `bytes`.
uint32_t ExtendCrc32c(uint32_t crc, std::span<const uint8_t> bytes);

}  // namespace voxelpipe
