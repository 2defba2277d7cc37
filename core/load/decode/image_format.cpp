// Sources: ITU-T T.81 (JPEG), annex B; Adobe Technical Note 5116 (components of CMYK and YCCK); KTX 2.0 specification,
// section 3.1; ISO/IEC 14496-12 (ftyp box of AVIF); Google, "WebP Container Specification".
#include "load/decode/image_format.h"

#include <algorithm>
#include <cstring>
#include <optional>
#include <string_view>

namespace voxelpipe {
namespace {

bool HasAt(std::span<const uint8_t> bytes, size_t at, std::string_view magic) {
  return bytes.size() >= at + magic.size() && std::memcmp(bytes.data() + at, magic.data(), magic.size()) == 0;
}

// The start-of-frame segment of a JPEG.
struct JpegFrame {
  uint8_t marker = 0;  // 0xc0 to 0xcf
  uint8_t precision = 0, components = 0;
};

std::optional<JpegFrame> FindFrame(std::span<const uint8_t> bytes) {
  constexpr size_t kMaxMetadataBytes = 16 << 20;  // behind more metadata the decoder looks for it
  bytes = bytes.first(std::min(bytes.size(), kMaxMetadataBytes));
  size_t at = 2;  // after SOI
  while (at + 4 <= bytes.size() && bytes[at] == 0xff) {
    const uint8_t marker = bytes[at + 1];
    if (marker == 0xff || marker == 0x01 || (marker >= 0xd0 && marker <= 0xd8)) {  // fill, or without a length
      at += marker == 0xff ? 1 : 2;
      continue;
    }
    if (marker == 0xda || marker == 0xd9) break;  // the scan begins, or the file ends
    const size_t length = size_t(bytes[at + 2]) << 8 | bytes[at + 3];
    const bool frame = marker >= 0xc0 && marker <= 0xcf && marker != 0xc4 && marker != 0xc8 && marker != 0xcc;
    if (frame && at + 10 <= bytes.size()) return JpegFrame{marker, bytes[at + 4], bytes[at + 9]};
    at += 2 + length;
  }
  return std::nullopt;
}

ImageKind KindOfJpeg(std::span<const uint8_t> bytes) {
  const std::optional<JpegFrame> frame = FindFrame(bytes);
  if (!frame) return {ImageFormat::kJpeg, ""};
  // Baseline, extended and progressive, by Huffman (SOF0 to 2) or arithmetic codes (SOF9, 10).
  const bool known = frame->marker <= 0xc2 || frame->marker == 0xc9 || frame->marker == 0xca;
  if (!known) return {ImageFormat::kNone, "lossless or hierarchical JPEG"};
  if (frame->precision != 8) return {ImageFormat::kNone, "JPEG of " + std::to_string(frame->precision) + " bits"};
  if (frame->components == 4) return {ImageFormat::kNone, "CMYK JPEG"};
  if (frame->components != 1 && frame->components != 3) {
    return {ImageFormat::kNone, "JPEG of " + std::to_string(frame->components) + " components"};
  }
  return {ImageFormat::kJpeg, ""};
}

ImageKind KindOfWebp(std::span<const uint8_t> bytes) {
  constexpr size_t kFlags = 20;
  constexpr uint8_t kAnimation = 0x02;
  const bool animated = HasAt(bytes, 12, "VP8X") && bytes.size() > kFlags && (bytes[kFlags] & kAnimation) != 0;
  return animated ? ImageKind{ImageFormat::kNone, "animated WebP"} : ImageKind{ImageFormat::kWebp, ""};
}

}  // namespace

ImageKind KindOfImage(std::span<const uint8_t> encoded) {
  if (HasAt(encoded, 0, "\x89PNG")) return {ImageFormat::kPng, ""};
  if (HasAt(encoded, 0, "\xff\xd8\xff")) return KindOfJpeg(encoded);
  if (HasAt(encoded, 0, "RIFF") && HasAt(encoded, 8, "WEBP")) return KindOfWebp(encoded);
  struct Other {
    size_t at;
    std::string_view magic;
    const char* name;
  };
  constexpr Other kOthers[] = {{0, "\xabKTX 20", "KTX2"},
                               {0, "\xabKTX 11", "KTX"},
                               {0, "DDS ", "DDS"},
                               {4, "ftypavif", "AVIF"},
                               {4, "ftypavis", "AVIF"},
                               {4, "ftyphei", "HEIF"},
                               {0, "sB", "Basis Universal"},
                               {0, "GIF8", "GIF"},
                               {0, "BM", "BMP"},
                               {0, "II*", "TIFF"},
                               {0, "MM", "TIFF"},
                               {0, "v/1\x01", "OpenEXR"},
                               {0, "#?RADIANCE", "Radiance"},
                               {0, "\xff\x0a", "JPEG XL"}};
  for (const Other& other : kOthers) {
    if (HasAt(encoded, other.at, other.magic)) return {ImageFormat::kNone, other.name};
  }
  return {ImageFormat::kNone, "an unknown format"};
}

}  // namespace voxelpipe
