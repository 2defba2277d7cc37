// PNG files of 8-bit RGB pictures.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"

namespace voxelpipe {

// Rows from the top, 3 bytes a pixel, sRGB.
struct Picture {
  int width = 0, height = 0;  // pixels
  std::vector<uint8_t> rgb;   // 3 * width * height
};

// The PNG file's bytes. `job` may be null. Errors: the job's; INTERNAL with libpng's message if it fails.
absl::StatusOr<std::vector<uint8_t>> EncodePng(const Picture& picture, const JobContext* job = nullptr);
// The most memory that it allocates.
uint64_t PngMemoryBytes(int width, int height);

}  // namespace voxelpipe
