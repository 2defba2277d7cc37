// Images are written with libpng and libjpeg.
#include "load/decode/image.h"

#include <cstdio>

#include <jpeglib.h>
#include <png.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <thread>

#include "gtest/gtest.h"

namespace voxelpipe {
namespace {

void AppendBytes(png_structp png, png_bytep data, size_t count) {
  auto* out = static_cast<std::vector<uint8_t>*>(png_get_io_ptr(png));
  out->insert(out->end(), data, data + count);
}

// A 2x2 PNG of any colour type; `rows` holds both rows of raw samples.
std::vector<uint8_t> Png(int color_type, int depth, std::vector<uint8_t> rows, double gamma = 0) {
  std::vector<uint8_t> out;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, nullptr, nullptr);
  png_infop info = png_create_info_struct(png);
  png_set_write_fn(png, &out, AppendBytes, nullptr);
  png_set_IHDR(png, info, 2, 2, depth, color_type, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
               PNG_FILTER_TYPE_DEFAULT);
  if (gamma != 0) png_set_gAMA(png, info, gamma);
  if (color_type == PNG_COLOR_TYPE_PALETTE) {
    const png_color palette[2] = {{10, 20, 30}, {200, 210, 220}};
    const png_byte alpha[1] = {7};
    png_set_PLTE(png, info, palette, 2);
    png_set_tRNS(png, info, alpha, 1, nullptr);
  }
  png_write_info(png, info);
  for (int y = 0; y < 2; ++y) png_write_row(png, rows.data() + size_t(y) * rows.size() / 2);
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  return out;
}

std::vector<uint8_t> Jpeg(int width, int height, bool gray, bool progressive = false) {
  jpeg_compress_struct jpeg;
  jpeg_error_mgr error;
  jpeg.err = jpeg_std_error(&error);
  jpeg_create_compress(&jpeg);
  unsigned char* data = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&jpeg, &data, &size);
  jpeg.image_width = JDIMENSION(width);
  jpeg.image_height = JDIMENSION(height);
  jpeg.input_components = gray ? 1 : 3;
  jpeg.in_color_space = gray ? JCS_GRAYSCALE : JCS_RGB;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, 100, TRUE);
  if (progressive) jpeg_simple_progression(&jpeg);
  jpeg_start_compress(&jpeg, TRUE);
  std::vector<uint8_t> row(size_t(width) * 3, 200);
  JSAMPROW rows[1] = {row.data()};
  for (int y = 0; y < height; ++y) jpeg_write_scanlines(&jpeg, rows, 1);
  jpeg_finish_compress(&jpeg);
  std::vector<uint8_t> out(data, data + size);
  jpeg_destroy_compress(&jpeg);
  std::free(data);
  return out;
}

Image Of(std::vector<uint8_t> encoded) {
  Image image;
  image.name = "picture";
  image.encoded = std::move(encoded);
  return image;
}

std::array<int, 4> Texel(const Image& image, size_t i) {
  return {image.rgba[4 * i], image.rgba[4 * i + 1], image.rgba[4 * i + 2], image.rgba[4 * i + 3]};
}

TEST(ImageTest, EveryPngColourTypeBecomesRgba) {
  Image rgb = Of(Png(PNG_COLOR_TYPE_RGB, 8, {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12}));
  ASSERT_TRUE(DecodeImage({}, rgb, {}).ok());
  EXPECT_EQ(rgb.width, 2u);
  EXPECT_EQ(Texel(rgb, 0), (std::array{1, 2, 3, 255}));
  EXPECT_EQ(Texel(rgb, 2), (std::array{7, 8, 9, 255}));  // rows from the top
  Image rgba = Of(Png(PNG_COLOR_TYPE_RGBA, 8, std::vector<uint8_t>(16, 9)));
  ASSERT_TRUE(DecodeImage({}, rgba, {}).ok());
  EXPECT_EQ(Texel(rgba, 3), (std::array{9, 9, 9, 9}));
  Image gray = Of(Png(PNG_COLOR_TYPE_GRAY, 8, {50, 60, 70, 80}));
  ASSERT_TRUE(DecodeImage({}, gray, {}).ok());
  EXPECT_EQ(Texel(gray, 1), (std::array{60, 60, 60, 255}));
  Image palette = Of(Png(PNG_COLOR_TYPE_PALETTE, 8, {0, 1, 1, 0}));
  ASSERT_TRUE(DecodeImage({}, palette, {}).ok());
  EXPECT_EQ(Texel(palette, 0), (std::array{10, 20, 30, 7}));
  EXPECT_EQ(Texel(palette, 1), (std::array{200, 210, 220, 255}));
  Image deep = Of(Png(PNG_COLOR_TYPE_GRAY, 16, {0x80, 0x80, 0xff, 0xff, 0, 0, 0, 0x7f}));
  ASSERT_TRUE(DecodeImage({}, deep, {}).ok());
  EXPECT_EQ(Texel(deep, 0), (std::array{0x80, 0x80, 0x80, 255}));
  EXPECT_EQ(Texel(deep, 3), (std::array{0, 0, 0, 255}));
}

TEST(ImageTest, GammaIsIgnoredAsGltfDemands) {
  Image image = Of(Png(PNG_COLOR_TYPE_GRAY, 8, {50, 60, 70, 80}, 1.0));
  ASSERT_TRUE(DecodeImage({}, image, {}).ok());
  EXPECT_EQ(Texel(image, 0), (std::array{50, 50, 50, 255}));
}

TEST(ImageTest, Jpeg) {
  for (const bool gray : {false, true}) {
    Image image = Of(Jpeg(33, 5, gray));
    ASSERT_TRUE(DecodeImage({}, image, {}).ok());
    EXPECT_EQ(image.width, 33u);
    EXPECT_EQ(image.rgba.size(), 4u * 33 * 5);
    for (size_t i = 0; i < 33 * 5; ++i) {
      EXPECT_NEAR(image.rgba[4 * i], 200, 2);
      EXPECT_EQ(image.rgba[4 * i + 3], 255);
    }
  }
}

TEST(ImageTest, ATruncatedJpegIsRefusedNotFilledWithGray) {
  const std::vector<uint8_t> jpeg = Jpeg(64, 64, false);
  for (const size_t missing : {12, 20, 40}) {
    Image image = Of({jpeg.begin(), jpeg.end() - long(missing)});
    EXPECT_EQ(DecodeImage({}, image, {}).code(), absl::StatusCode::kInvalidArgument) << missing;
    EXPECT_TRUE(image.rgba.empty());
  }
  Image image = Of({jpeg.begin(), jpeg.end() - 2});  // only the end marker is missing: every texel is there
  EXPECT_TRUE(DecodeImage({}, image, {}).ok());
}

TEST(ImageTest, AJpegOfEndlesslyManyScansIsRefused) {
  std::vector<uint8_t> jpeg = Jpeg(16, 16, false, /*progressive=*/true);
  Image good = Of(jpeg);
  ASSERT_TRUE(DecodeImage({}, good, {}).ok());
  const uint8_t sos[] = {0xff, 0xda};
  const auto last = std::find_end(jpeg.begin(), jpeg.end(), std::begin(sos), std::end(sos));
  const std::vector<uint8_t> scan(last, jpeg.end() - 2);
  jpeg.resize(jpeg.size() - 2);
  for (int i = 0; i < 600; ++i) jpeg.insert(jpeg.end(), scan.begin(), scan.end());
  jpeg.insert(jpeg.end(), {0xff, 0xd9});
  Image image = Of(jpeg);
  const absl::Status s = DecodeImage({}, image, {});
  EXPECT_EQ(s.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(std::string(s.message()).find("more than 500 scans"), std::string::npos) << s;
}

// A large progressive image whose last scan is repeated.
std::vector<uint8_t> JpegOfScans(int edge, int more_scans) {
  std::vector<uint8_t> jpeg = Jpeg(edge, edge, /*gray=*/true, /*progressive=*/true);
  const uint8_t sos[] = {0xff, 0xda};
  const auto last = std::find_end(jpeg.begin(), jpeg.end(), std::begin(sos), std::end(sos));
  const std::vector<uint8_t> scan(last, jpeg.end() - 2);
  jpeg.resize(jpeg.size() - 2);
  for (int i = 0; i < more_scans; ++i) jpeg.insert(jpeg.end(), scan.begin(), scan.end());
  jpeg.insert(jpeg.end(), {0xff, 0xd9});
  return jpeg;
}

TEST(ImageTest, ScansTimesTexelsAreBounded) {
  Image good = Of(JpegOfScans(256, 100));
  EXPECT_TRUE(DecodeImage({}, good, {}).ok());
  Image image = Of(JpegOfScans(4096, 100));
  const absl::Status s = DecodeImage({}, image, {});
  EXPECT_EQ(s.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(std::string(s.message()).find("scans"), std::string::npos) << s;
}

TEST(ImageTest, CoefficientsOfAProgressiveJpegAreTakenOfTheJobsMemory) {
  Image image = Of(JpegOfScans(256, 0));
  MemoryBudget enough(256 * 256 * (4 + 2)), little(256 * 256 * (4 + 2) - 1);
  JobContext job;
  job.set_memory(&little);
  EXPECT_EQ(DecodeImage(job, image, {}).code(), absl::StatusCode::kResourceExhausted);
  EXPECT_EQ(little.used_bytes(), 0u);
  job.set_memory(&enough);
  EXPECT_TRUE(DecodeImage(job, image, {}).ok());
  EXPECT_EQ(enough.used_bytes(), uint64_t{256 * 256 * 4});
  image.memory.reset();
}

TEST(ImageTest, ACancelledJobIsLetGoBetweenScans) {
  Image image = Of(JpegOfScans(4096, 50));
  JobContext job;
  std::thread canceller([&job] {
    std::this_thread::sleep_for(std::chrono::milliseconds(150));
    job.Cancel();
  });
  const absl::Status status = DecodeImage(job, image, {});
  canceller.join();
  EXPECT_EQ(status.code(), absl::StatusCode::kCancelled) << status;
  EXPECT_TRUE(image.rgba.empty());
}

TEST(ImageTest, BrokenDataIsNamedAndLeavesNothing) {
  const std::vector<uint8_t> png = Png(PNG_COLOR_TYPE_RGB, 8, std::vector<uint8_t>(12, 3));
  for (size_t n = 8; n < png.size() - 12; ++n) {  // the last chunk holds no pixels
    Image image = Of({png.begin(), png.begin() + long(n)});
    EXPECT_FALSE(DecodeImage({}, image, {}).ok()) << n;
    EXPECT_TRUE(image.rgba.empty());
  }
  Image jpeg = Of({0xff, 0xd8, 0xff, 0x00, 0x11});
  const absl::Status s = DecodeImage({}, jpeg, {});
  EXPECT_EQ(s.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(std::string(s.message()).find("picture"), std::string::npos);
  Image other = Of({'R', 'I', 'F', 'F'});
  EXPECT_EQ(DecodeImage({}, other, {}).code(), absl::StatusCode::kUnimplemented);
}

TEST(ImageTest, PixelsAreCountedBeforeDecoding) {
  std::vector<uint8_t> bomb = Png(PNG_COLOR_TYPE_RGB, 8, std::vector<uint8_t>(12, 3));
  bomb[16] = bomb[20] = 0x7f;  // width and height of the header, 2^31 each; its checksum follows
  const uint32_t crc = uint32_t(crc32(0, bomb.data() + 12, 17));
  for (int i = 0; i < 4; ++i) bomb[size_t(29 + i)] = uint8_t(crc >> (24 - 8 * i));
  Image image = Of(bomb);
  EXPECT_EQ(DecodeImage({}, image, {}).code(), absl::StatusCode::kResourceExhausted);
  LoadLimits limits;
  limits.max_image_pixels = 33 * 5 - 1;
  Image jpeg = Of(Jpeg(33, 5, false));
  EXPECT_EQ(DecodeImage({}, jpeg, limits).code(), absl::StatusCode::kResourceExhausted);
}

// A part of one triangle for each material.
void UseMaterials(TriangleMesh& mesh) {
  for (size_t i = 0; i < mesh.materials.size(); ++i) {
    MeshPart& part = mesh.parts.emplace_back();
    part.triangle_count = 1;
    part.material = int32_t(i);
    part.has_uv[0] = true;
  }
}

TEST(PrepareTexturesTest, DecodesWhatBaseColourUsesAndSwitchesOffTheUnreadable) {
  TriangleMesh mesh;
  mesh.images = {std::make_shared<Image>(Of(Png(PNG_COLOR_TYPE_GRAY, 8, {1, 2, 3, 4}))),
                 std::make_shared<Image>(Of({'K', 'T', 'X'})), std::make_shared<Image>(Of({'b', 'a', 'd'}))};
  mesh.textures.resize(3);
  for (int i = 0; i < 3; ++i) mesh.textures[size_t(i)].image = i;
  mesh.materials.resize(2);
  mesh.materials[0].base_color.texture = 0;
  mesh.materials[1].base_color.texture = 1;
  mesh.materials[1].emissive.texture = 2;  // not in use
  UseMaterials(mesh);
  ASSERT_TRUE(PrepareTextures(mesh, {}, {.base_color = true}).ok());
  EXPECT_EQ(mesh.images[0]->rgba.size(), 16u);
  ASSERT_TRUE(mesh.images[1]->fault.has_value());
  EXPECT_EQ(mesh.images[1]->fault->code, WarningCode::kTextureUndecodable);
  EXPECT_EQ(mesh.images[1]->fault->place, "image 1");
  EXPECT_EQ(mesh.images[2]->fault, std::nullopt) << "nobody reads it";
  LoadLimits limits;
  limits.max_total_image_pixels = 3;
  EXPECT_EQ(PrepareTextures(mesh, limits, {.base_color = true}).code(), absl::StatusCode::kResourceExhausted);
}

TEST(PrepareTexturesTest, BuildsTheLevelsThatAreSampledInTheirColourSpace) {
  TriangleMesh mesh;
  for (int i = 0; i < 3; ++i)
    mesh.images.push_back(std::make_shared<Image>(Of(Png(PNG_COLOR_TYPE_GRAY, 8, {1, 2, 3, 4}))));
  mesh.textures.resize(3);
  for (int i = 0; i < 3; ++i) mesh.textures[size_t(i)].image = i;
  mesh.materials.resize(1);
  mesh.materials[0].base_color.texture = 0;
  mesh.materials[0].emissive.texture = 1;
  mesh.materials[0].metallic_roughness.texture = 2;
  UseMaterials(mesh);
  const TextureUse metal{false, false, true};
  ASSERT_TRUE(PrepareTextures(mesh, {}, metal).ok());
  EXPECT_TRUE(mesh.images[0]->rgba.empty() && mesh.images[1]->rgba.empty());
  EXPECT_EQ(mesh.images[2]->linear_mips.size(), 1u);
  EXPECT_TRUE(mesh.images[2]->srgb_mips.empty());
  mesh.materials[0].alpha_mode = AlphaMode::kMask;  // now the base colour's alpha matters
  ASSERT_TRUE(PrepareTextures(mesh, {}, metal).ok());
  EXPECT_EQ(mesh.images[0]->srgb_mips.size(), 1u);
  ASSERT_TRUE(PrepareTextures(mesh).ok());
  EXPECT_EQ(mesh.images[1]->srgb_mips.size(), 1u);
}

TEST(PrepareTexturesTest, TexelsAndLevelsAreTakenOfTheJobsMemory) {
  const auto prepare = [](MemoryBudget& memory) {
    TriangleMesh mesh;
    mesh.images = {std::make_shared<Image>(Of(Png(PNG_COLOR_TYPE_GRAY, 8, {1, 2, 3, 4})))};
    mesh.textures.resize(1);
    mesh.textures[0].image = 0;
    mesh.materials.resize(1);
    mesh.materials[0].base_color.texture = 0;
    UseMaterials(mesh);
    JobContext job;
    job.set_memory(&memory);
    const absl::Status status = PrepareTexturesFor(job, mesh, {}, {.base_color = true});
    EXPECT_EQ(memory.used_bytes(), status.ok() ? memory.limit_bytes() : mesh.images[0]->rgba.size());
    return status;
  };
  constexpr uint64_t kBytes = 4 * 4 + 16;
  MemoryBudget enough(kBytes), little(kBytes - 1);
  EXPECT_TRUE(prepare(enough).ok());
  EXPECT_EQ(enough.used_bytes(), 0u) << "it goes with the mesh";
  EXPECT_EQ(prepare(little).code(), absl::StatusCode::kResourceExhausted);
}

}  // namespace
}  // namespace voxelpipe
