// Decoding of WebP images.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "absl/status/status.h"
#include "base/job_context.h"

namespace voxelpipe {

struct WebpSize {
  uint32_t width = 0, height = 0;
  // What its decoder takes beside the texels, but for the prefix codes of a lossless image: at most 65,536 sets of
  // about 6 KB, which the header does not contain.
  uint64_t working_bytes = 0;
};

// The size that the header says, nothing for a broken one.
std::optional<WebpSize> ReadWebpSize(std::span<const uint8_t> encoded);

// Decodes to 8-bit RGBA, rows from the top, into `rgba` of 4 * width * height bytes. Alpha is not multiplied in.
// The job is polled between pieces of the encoded bytes: where few of them hold all texels, as of a single colour, not
// in between.
// Errors: INVALID_ARGUMENT saying what is broken, without naming the image; RESOURCE_EXHAUSTED out of memory; the
// job's.
absl::Status DecodeWebp(const JobContext& job, std::span<const uint8_t> encoded, const WebpSize& size,
                        std::span<uint8_t> rgba);

}  // namespace voxelpipe
