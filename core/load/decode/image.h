// Decoding of PNG, JPEG and WebP images, lazily and only after the pixel count was checked.
#pragma once

#include "absl/status/status.h"
#include "base/job_context.h"
#include "mesh/scene/load_limits.h"
#include "mesh/triangle_mesh.h"

namespace voxelpipe {

// Decodes image.encoded into image.rgba (8-bit RGBA, rows from the top; 16-bit PNG is rounded to 8). No-op if decoded.
// Memory is charged to the job before it is allocated; the job is polled between rows and scans. Errors:
// INVALID_ARGUMENT naming the image for broken data, RESOURCE_EXHAUSTED past the pixel limits, UNIMPLEMENTED saying why
// for an image without bytes and for formats that are not decoded; the job's.
absl::Status DecodeImage(const JobContext& job, Image& image, const LoadLimits& limits);

// Decodes every image that the textures in `use` sample, and builds the mip levels that their filters read
// (load/decode/mips.h). Alpha masks sample the base colour in addition to `use`; materials without triangles sample
// nothing. An image without bytes or of a format that is not decoded has no texels, its fault says why, and only the
// factor is used. Decoded images are kept. Errors: those of DecodeImage; RESOURCE_EXHAUSTED past
// limits.max_total_image_pixels, or if texels and levels exceed the job's memory; the job's. Not thread-safe for one
// mesh; call before the pipeline when a shader reads textures.
absl::Status PrepareTexturesFor(const JobContext& job, TriangleMesh& mesh, const LoadLimits& limits,
                                const TextureUse& use);

// The same for callers without a job.
absl::Status PrepareTextures(TriangleMesh& mesh, const LoadLimits& limits = {},
                             const TextureUse& use = {true, true, true});

// Sets the fault of every image that has no bytes or is of a format that is not decoded, as decoding would, by its
// first bytes alone.
void CheckImages(const TriangleMesh& mesh);

}  // namespace voxelpipe
