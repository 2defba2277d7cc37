// The checksum of ZIP archives.
#pragma once

#include <cstdint>
#include <span>

namespace voxelpipe {

// CRC-32 (ISO 3309, as in ZIP and PNG) of what `crc` is the checksum of, followed by `bytes`; 0 to begin with.
// "123456789" gives 0xCBF43926.
uint32_t Crc32(uint32_t crc, std::span<const uint8_t> bytes);

}  // namespace voxelpipe
