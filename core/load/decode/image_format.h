// What an encoded image is, by its first bytes and headers.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace voxelpipe {

enum class ImageFormat { kNone, kPng, kJpeg, kWebp };

struct ImageKind {
  ImageFormat format = ImageFormat::kNone;  // that it is decoded as; kNone: it is not decoded
  std::string name;                         // of what is not decoded: "KTX2", "CMYK JPEG", "an unknown format"
};

// The first bytes decide, not the type that a file claims. Formats that are decoded can still have kinds that are not:
// JPEG of four components, of 12 bits, lossless or hierarchical; animated WebP. Never reads past the end; what is
// broken counts as decoded, so that its decoder says what is wrong.
ImageKind KindOfImage(std::span<const uint8_t> encoded);

}  // namespace voxelpipe
