// CRC-32C (Castagnoli), the checksum of result pieces.
#pragma once

#include <cstdint>
#include <span>

namespace voxelpipe {

// CRC-32C of `bytes`, as iSCSI, ext4 and SSE4.2 define it (reflected polynomial 0x82f63b78, initial and final inversion). The CRC
// of "123456789" is 0xe3069283. Uses the processor's instruction where there is one; the value is the same.
uint32_t Crc32c(std::span<const uint8_t> bytes);

// The same without the instruction, for processors that lack it.
uint32_t Crc32cPortable(std::span<const uint8_t> bytes);

}  // namespace voxelpipe
