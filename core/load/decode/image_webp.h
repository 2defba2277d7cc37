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
  // Bytes of the decoder besides the texels, without the prefix codes of a lossless image: at most 65,536 sets of about
  // 6 KB, whose number the header does not contain.
  uint64_t working_bytes = 0;
};

// The size in the header; empty for a broken one.
std::optional<WebpSize> ReadWebpSize(std::span<const uint8_t> encoded);

// Decodes to 8-bit RGBA, rows from the top, into `rgba` of 4 * width * height bytes. Alpha is not premultiplied. The
// job is polled between pieces of the encoded bytes; if a few bytes hold all texels, as for a single colour, it is not
// polled in between. Errors: INVALID_ARGUMENT saying what is broken, without naming the image; RESOURCE_EXHAUSTED out
// of memory; the job's.
absl::Status DecodeWebp(const JobContext& job, std::span<const uint8_t> encoded, const WebpSize& size,
                        std::span<uint8_t> rgba);

}  // namespace voxelpipe
