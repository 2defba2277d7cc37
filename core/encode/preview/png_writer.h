// PNG files of 8-bit RGB pictures.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"

namespace voxelpipe {

// Rows from the top, 3 bytes a pixel, sRGB.
struct Picture {
  int width = 0, height = 0;  // pixels
  std::vector<uint8_t> rgb;   // 3 * width * height
};

// The PNG file's bytes. INTERNAL with libpng's message if it fails.
absl::StatusOr<std::vector<uint8_t>> EncodePng(const Picture& picture);

}  // namespace voxelpipe
