#include "reply/zstd_frame.h"

#include <zstd.h>

namespace voxelpipe {

absl::Status DecompressFrame(std::span<const uint8_t> frame, uint64_t raw_bytes, std::vector<uint8_t>& bytes) {
  // The frame declares its size in its first bytes, so a false size is found before memory is allocated.
  if (ZSTD_getFrameContentSize(frame.data(), frame.size()) != raw_bytes ||
      ZSTD_findFrameCompressedSize(frame.data(), frame.size()) != frame.size()) {
    return absl::DataLossError(
        "the server's result: a compressed piece that is not one zstd frame of the announced size");
  }
  bytes.resize(raw_bytes);
  if (ZSTD_decompress(bytes.data(), bytes.size(), frame.data(), frame.size()) != raw_bytes) {
    return absl::DataLossError("the server's result: a compressed piece is broken");
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe
