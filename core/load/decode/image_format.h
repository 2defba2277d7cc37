// Detects the format of an encoded image from its first bytes and headers.
#pragma once

#include <cstdint>
#include <span>
#include <string>

namespace voxelpipe {

enum class ImageFormat { kNone, kPng, kJpeg, kWebp };

struct ImageKind {
  ImageFormat format = ImageFormat::kNone;  // the format to decode; kNone: not decoded
  std::string name;                         // of a format that is not decoded: "KTX2", "CMYK JPEG", "an unknown format"
};

// The first bytes decide, not the declared type. Variants that are not decoded: JPEG of four components, of 12 bits,
// lossless or hierarchical; animated WebP. Never reads past the end. A broken image keeps its format, so that the
// decoder reports what is wrong.
ImageKind KindOfImage(std::span<const uint8_t> encoded);

}  // namespace voxelpipe
