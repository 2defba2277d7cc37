// Files that third-party decoders read: libdraco, libmeshoptimizer, libpng, libjpeg, libwebp, zlib and
// expat (3MF).
#pragma once

#include <cstdint>
#include <span>

#include "absl/status/status.h"
#include "load/decode/mesh_format.h"
#include "mesh/scene/material.h"

namespace voxelpipe {

// True if loading the file, and decoding those of its textures, may run one of them. Searches the text alone: true may
// be wrong, false is not. O(size of the JSON or text), without parsing it. The job is polled; the answer is of no use
// once it is over.
bool MayNeedForeignDecoder(const JobContext& job, std::span<const uint8_t> file, MeshFormat format,
                           const TextureUse& textures);

// After this call no such decoder runs in this process: code that would call one returns INTERNAL. Cannot be undone.
// Thread-safe.
void ForbidForeignDecoders();
// OK, or the error after ForbidForeignDecoders.
absl::Status CheckForeignDecoders();

}  // namespace voxelpipe
