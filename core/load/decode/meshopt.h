// EXT_meshopt_compression and KHR_meshopt_compression: decoding of one compressed buffer view.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "absl/status/statusor.h"

namespace voxelpipe {

struct MeshoptView {
  uint64_t count = 0, byte_stride = 0;  // elements, bytes an element
  std::string mode;                     // ATTRIBUTES, TRIANGLES, INDICES
  std::string filter = "NONE";          // NONE, OCTAHEDRAL, QUATERNION, EXPONENTIAL; KHR also COLOR
  bool khr = false;                     // KHR_meshopt_compression: also version 1 of the vertex codec
};

// In: the compressed bytes and the fields of the extension object. Out: count * byte_stride decoded bytes. Errors:
// INVALID_ARGUMENT for a mode, filter, stride or stream that is not valid. The declared count is checked against the
// compressed size before allocation; the caller must have charged the bytes to the job's memory.
absl::StatusOr<std::vector<uint8_t>> DecodeMeshopt(std::span<const uint8_t> compressed, const MeshoptView& view);

}  // namespace voxelpipe
