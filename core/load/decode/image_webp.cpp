#include "load/decode/image_webp.h"

#include <webp/decode.h>

#include <algorithm>
#include <memory>

namespace voxelpipe {
namespace {

struct DeleteDecoder {
  void operator()(WebPIDecoder* decoder) const { WebPIDelete(decoder); }
};

const char* WhatIsWrong(VP8StatusCode status) {
  switch (status) {
    case VP8_STATUS_BITSTREAM_ERROR: return "broken WebP: the bit stream is damaged";
    case VP8_STATUS_UNSUPPORTED_FEATURE: return "broken WebP: a feature that does not exist";
    case VP8_STATUS_SUSPENDED:
    case VP8_STATUS_NOT_ENOUGH_DATA: return "broken WebP: the data ends too early";
    default: return "broken WebP";
  }
}

}  // namespace

std::optional<WebpSize> ReadWebpSize(std::span<const uint8_t> encoded) {
  WebPBitstreamFeatures features;
  if (WebPGetFeatures(encoded.data(), encoded.size(), &features) != VP8_STATUS_OK) return std::nullopt;
  if (features.width <= 0 || features.height <= 0) return std::nullopt;
  WebpSize size{uint32_t(features.width), uint32_t(features.height), 0};
  // Lossless: all texels as ARGB and some rows more. Lossy: planes of alpha and a few rows; rows are at most 2^14
  // texels.
  const uint64_t texels = uint64_t{size.width} * size.height;
  size.working_bytes = 4 * texels + 64 * uint64_t{size.width} + (uint64_t{1} << 20);
  return size;
}

absl::Status DecodeWebp(const JobContext& job, std::span<const uint8_t> encoded, const WebpSize& size,
                        std::span<uint8_t> rgba) {
  constexpr size_t kPieceBytes = 16 << 10;
  const std::unique_ptr<WebPIDecoder, DeleteDecoder> decoder(
      WebPINewRGB(MODE_RGBA, rgba.data(), rgba.size(), int(4 * size.width)));
  if (decoder == nullptr) return absl::ResourceExhaustedError("out of memory while decoding");
  VP8StatusCode status = VP8_STATUS_SUSPENDED;
  for (size_t end = 0; status == VP8_STATUS_SUSPENDED && end < encoded.size();) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    end = std::min(encoded.size(), end + kPieceBytes);
    status = WebPIUpdate(decoder.get(), encoded.data(), end);
  }
  if (status == VP8_STATUS_OUT_OF_MEMORY) return absl::ResourceExhaustedError("out of memory while decoding");
  if (status != VP8_STATUS_OK) return absl::InvalidArgumentError(WhatIsWrong(status));
  return absl::OkStatus();
}

}  // namespace voxelpipe
