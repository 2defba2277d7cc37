// Decompression of one piece of a result.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "absl/status/status.h"

namespace voxelpipe {

// In: a zstd frame, and how many bytes it is said to hold; the caller has checked that so many may come. Out: the
// bytes, in `bytes`, which keeps its memory from call to call.
// Errors: DATA_LOSS where the frame is broken, or holds another number of bytes.
absl::Status DecompressFrame(std::span<const uint8_t> frame, uint64_t raw_bytes, std::vector<uint8_t>& bytes);

}  // namespace voxelpipe
