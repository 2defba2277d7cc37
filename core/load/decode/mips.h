// Builds the mip levels of a texture.
#pragma once

#include <cstdint>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "base/vec.h"

namespace voxelpipe {

// In: 8-bit RGBA rows from the top, width * height texels; `srgb` if their colours are sRGB. Out: levels 1 to the
// single texel, in the layout of mesh/views/mips.h, linear RGBA; empty for a single texel. A box filter: each texel is
// the mean of the area that it covers, alpha not weighted in; odd edges weight three texels by their shares, so that
// every level has the image's mean. Summed in double in a fixed order, rounded to float at each level. The job's error
// once it ended. The caller must have charged the bytes to the job's memory. May throw bad_alloc.
absl::StatusOr<std::vector<Vec4f>> BuildMips(const JobContext& job, const uint8_t* rgba, uint32_t width,
                                             uint32_t height, bool srgb);

}  // namespace voxelpipe
