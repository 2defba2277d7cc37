// Which images are decoded, and WebP. Images are written with libwebp and libjpeg.
#include "load/decode/image_format.h"

#include <cstdio>

#include <jpeglib.h>
#include <webp/encode.h>

#include <cstdlib>
#include <string>

#include "gmock/gmock.h"
#include "gtest/gtest.h"
#include "load/decode/image.h"
#include "load/decode/image_webp.h"

namespace voxelpipe {
namespace {

using ::testing::HasSubstr;

std::vector<uint8_t> Rgba(int width, int height) {
  std::vector<uint8_t> rgba;
  for (int i = 0; i < width * height; ++i) {
    rgba.insert(rgba.end(), {uint8_t(i * 7), uint8_t(255 - i), uint8_t(i / 3), uint8_t(i % 2 == 0 ? 255 : i)});
  }
  return rgba;
}

std::vector<uint8_t> Webp(int width, int height, bool lossless) {
  const std::vector<uint8_t> rgba = Rgba(width, height);
  uint8_t* out = nullptr;
  const size_t size = lossless ? WebPEncodeLosslessRGBA(rgba.data(), width, height, 4 * width, &out)
                               : WebPEncodeRGBA(rgba.data(), width, height, 4 * width, 100, &out);
  std::vector<uint8_t> bytes(out, out + size);
  WebPFree(out);
  return bytes;
}

// A JPEG of so many components, as they are.
std::vector<uint8_t> Jpeg(int components, J_COLOR_SPACE space) {
  jpeg_compress_struct jpeg;
  jpeg_error_mgr error;
  jpeg.err = jpeg_std_error(&error);
  jpeg_create_compress(&jpeg);
  unsigned char* data = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&jpeg, &data, &size);
  jpeg.image_width = jpeg.image_height = 4;
  jpeg.input_components = components;
  jpeg.in_color_space = space;
  jpeg_set_defaults(&jpeg);
  jpeg_start_compress(&jpeg, TRUE);
  std::vector<uint8_t> row(size_t(4) * size_t(components), 90);
  JSAMPROW rows[1] = {row.data()};
  for (int y = 0; y < 4; ++y) jpeg_write_scanlines(&jpeg, rows, 1);
  jpeg_finish_compress(&jpeg);
  std::vector<uint8_t> out(data, data + size);
  jpeg_destroy_compress(&jpeg);
  std::free(data);
  return out;
}

std::string NameOf(std::vector<uint8_t> bytes) {
  const ImageKind kind = KindOfImage(bytes);
  return kind.format == ImageFormat::kNone ? kind.name : "";
}

std::vector<uint8_t> TextBytes(const std::string& text) {
  return {text.begin(), text.end()};
}

Image Picture(std::vector<uint8_t> encoded) {
  Image image;
  image.name = "picture";
  image.encoded = std::move(encoded);
  return image;
}

TEST(ImageFormat, WhatIsNotDecodedHasAName) {
  EXPECT_EQ(NameOf(TextBytes("\xabKTX 20\xbb\r\n\x1a\n")), "KTX2");
  EXPECT_EQ(NameOf(TextBytes(std::string("\0\0\0\x1c", 4) + "ftypavif")), "AVIF");
  EXPECT_EQ(NameOf(TextBytes("DDS |")), "DDS");
  EXPECT_EQ(NameOf(TextBytes("bad")), "an unknown format");
  EXPECT_EQ(NameOf({}), "an unknown format");
  EXPECT_EQ(NameOf(Jpeg(4, JCS_CMYK)), "CMYK JPEG");
  EXPECT_EQ(NameOf(Jpeg(3, JCS_RGB)), "");
  EXPECT_EQ(NameOf(Jpeg(1, JCS_GRAYSCALE)), "");
  EXPECT_EQ(NameOf(Webp(3, 2, true)), "");
  std::vector<uint8_t> animated = TextBytes(std::string("RIFF\x1e\0\0\0WEBPVP8X\x0a\0\0\0\x02\0\0\0\0\0\0\0\0\0", 30));
  EXPECT_EQ(NameOf(animated), "animated WebP");
  std::vector<uint8_t> deep = Jpeg(3, JCS_RGB);
  for (size_t i = 2; i + 4 < deep.size(); ++i) {
    if (deep[i] != 0xff || deep[i + 1] != 0xc0) continue;
    deep[i + 4] = 12;
    EXPECT_EQ(NameOf(deep), "JPEG of 12 bits");
    deep[i + 1] = 0xc3;
    EXPECT_EQ(NameOf(deep), "lossless or hierarchical JPEG");
    return;
  }
  FAIL() << "no frame";
}

TEST(ImageFormat, NoPrefixIsReadPastItsEnd) {
  for (const std::vector<uint8_t>& whole : {Jpeg(4, JCS_CMYK), Webp(3, 2, false), TextBytes("\xabKTX 20\xbb\r\n")}) {
    for (size_t n = 0; n <= whole.size(); ++n) {
      const std::vector<uint8_t> prefix(whole.begin(), whole.begin() + long(n));  // its own allocation, for sanitizers
      (void)KindOfImage(prefix);
    }
  }
}

TEST(ImageFormat, WebpLosslessAndLossy) {
  for (const bool lossless : {true, false}) {
    Image image = Picture(Webp(33, 17, lossless));
    ASSERT_TRUE(DecodeImage({}, image, {}).ok());
    EXPECT_EQ(image.width, 33u);
    EXPECT_EQ(image.height, 17u);
    ASSERT_EQ(image.rgba.size(), 4u * 33 * 17);
    const std::vector<uint8_t> want = Rgba(33, 17);
    for (size_t i = 3; i < want.size(); i += 4) EXPECT_EQ(image.rgba[i], want[i]) << "alpha has no loss";
    if (!lossless) continue;
    for (size_t i = 0; i < want.size(); ++i) {
      if (want[i / 4 * 4 + 3] == 0) continue;  // colours of what cannot be seen may change
      EXPECT_EQ(image.rgba[i], want[i]) << i;
    }
  }
}

TEST(ImageFormat, BrokenWebpIsNamedAndLeavesNothing) {
  const std::vector<uint8_t> whole = Webp(16, 16, true);
  for (const size_t n : {size_t{12}, size_t{20}, whole.size() / 2, whole.size() - 2}) {
    Image image = Picture({whole.begin(), whole.begin() + long(n)});
    const absl::Status status = DecodeImage({}, image, {});
    EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << n;
    EXPECT_THAT(std::string(status.message()), HasSubstr("image 'picture': broken WebP"));
    EXPECT_TRUE(image.rgba.empty());
  }
  LoadLimits limits;
  limits.max_image_pixels = 255;
  Image image = Picture(whole);
  EXPECT_EQ(DecodeImage({}, image, limits).code(), absl::StatusCode::kResourceExhausted) << "before it is decoded";
}

TEST(ImageFormat, WebpEndsWithItsJob) {
  const std::vector<uint8_t> whole = Webp(64, 64, false);
  const std::optional<WebpSize> size = ReadWebpSize(whole);
  ASSERT_TRUE(size.has_value());
  std::vector<uint8_t> rgba(size_t{4} * 64 * 64);
  JobContext job;
  job.Cancel();
  EXPECT_EQ(DecodeWebp(job, whole, *size, rgba), job.Check());
}

}  // namespace
}  // namespace voxelpipe
