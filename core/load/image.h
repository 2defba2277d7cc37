// Decoding of PNG and JPEG images, lazily and only after the pixel count was checked.
#pragma once

#include "absl/status/status.h"
#include "load/limits.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// Decodes image.encoded into image.rgba (8-bit RGBA, rows from the top; 16-bit PNG is rounded to 8). No-op if decoded.
// Errors: INVALID_ARGUMENT naming the image for broken data, RESOURCE_EXHAUSTED past the pixel limits,
// UNIMPLEMENTED naming the type for formats other than PNG and JPEG (KTX2, WebP).
absl::Status DecodeImage(Image& image, const LoadLimits& limits);

// Decodes every image that the textures in `use` sample, and builds the mip levels that their filters read
// (load/mips.h). Alpha masks sample the base colour whatever is in use. A texture whose image is of a format that this
// build cannot read is switched off (image = -1), so that the factor alone is used. What is decoded already stays.
// Errors: those of DecodeImage; RESOURCE_EXHAUSTED past limits.max_total_image_pixels, or past limits.max_decoded_bytes
// for texels and levels together. Not thread-safe for one mesh; call before the pipeline when a shader reads textures.
absl::Status PrepareTextures(TriangleMesh& mesh, const LoadLimits& limits = {},
                             const TextureUse& use = {true, true, true});

}  // namespace voxelpipe
