// Decompression of one piece of a result.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/status.h"

namespace voxelpipe {

// In: a zstd frame, and its declared number of bytes, which the caller has checked against its limits. Out: the bytes,
// in `bytes`, whose memory is reused. Errors: DATA_LOSS if the frame is broken or holds another number of bytes.
absl::Status DecompressFrame(std::span<const uint8_t> frame, uint64_t raw_bytes, std::vector<uint8_t>& bytes);

}  // namespace voxelpipe
