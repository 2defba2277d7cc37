#include "load/image.h"

#include <cstdio>  // jpeglib.h needs FILE

#include <jerror.h>
#include <jpeglib.h>
#include <png.h>

#include <csetjmp>
#include <cstring>
#include <new>
#include <set>
#include <span>
#include <vector>

#include "absl/strings/str_cat.h"
#include "load/foreign_decoders.h"
#include "load/image_format.h"
#include "load/image_webp.h"
#include "load/mips.h"
#include "mesh/texture_faults.h"
#include "shaders/mips.h"

namespace voxelpipe {
namespace {

absl::Status Invalid(const Image& image, const std::string& why) {
  return absl::InvalidArgumentError(absl::StrCat("image '", image.name, "': ", why));
}

absl::Status CheckPixels(const Image& image, uint64_t width, uint64_t height, const LoadLimits& limits) {
  if (width == 0 || height == 0) return Invalid(image, "has no pixels");
  if (width * height > limits.max_image_pixels) {  // both are 32-bit
    return absl::ResourceExhaustedError(absl::StrCat("image '", image.name, "': ", width, " x ", height,
                                                     " pixels, the limit is ", limits.max_image_pixels, " pixels"));
  }
  return absl::OkStatus();
}

struct PngReader {
  std::span<const uint8_t> left;  // bytes not read yet
  std::string message;
};

void OnPngError(png_structp png, png_const_charp message) {
  static_cast<PngReader*>(png_get_error_ptr(png))->message = message;
  png_longjmp(png, 1);
}

void OnPngWarning(png_structp, png_const_charp) {}

void ReadPngBytes(png_structp png, png_bytep out, size_t count) {
  auto& left = static_cast<PngReader*>(png_get_io_ptr(png))->left;
  if (count > left.size()) png_error(png, "the data ends too early");
  std::memcpy(out, left.data(), count);
  left = left.subspan(count);
}

// Decodes to 8-bit RGBA. glTF ignores colour profiles and gamma, hence not libpng's simplified interface, which applies
// them. Holds nothing that a jump would leak. Out: false after a jump, else `status`.
bool ReadPng(png_structp png, png_infop info, const Image& image, const LoadLimits& limits, std::vector<uint8_t>& rgba,
             std::vector<png_bytep>& rows, absl::Status& status) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_read_info(png, info);
  const uint64_t width = png_get_image_width(png, info), height = png_get_image_height(png, info);
  status = CheckPixels(image, width, height, limits);
  if (!status.ok()) return true;
  png_set_expand(png);
  png_set_scale_16(png);
  png_set_gray_to_rgb(png);
  png_set_add_alpha(png, 255, PNG_FILLER_AFTER);
  png_set_interlace_handling(png);
  png_read_update_info(png, info);
  rgba.resize(size_t{4} * width * height);
  for (uint64_t y = 0; y < height; ++y) rows.push_back(rgba.data() + size_t{4} * width * y);
  png_read_image(png, rows.data());
  return true;
}

absl::Status DecodePng(Image& image, const LoadLimits& limits) {
  PngReader reader{image.encoded, ""};
  std::vector<uint8_t> rgba;
  std::vector<png_bytep> rows;
  absl::Status status;
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &reader, OnPngError, OnPngWarning);
  png_infop info = png == nullptr ? nullptr : png_create_info_struct(png);
  if (info == nullptr) {
    png_destroy_read_struct(&png, nullptr, nullptr);
    return absl::ResourceExhaustedError(absl::StrCat("image '", image.name, "': out of memory while decoding"));
  }
  png_set_read_fn(png, &reader, ReadPngBytes);
  png_set_user_limits(png, 0x7fffffff, 0x7fffffff);  // the pixel limit is ours, below
  bool done = false;
  try {
    done = ReadPng(png, info, image, limits, rgba, rows, status);
  } catch (const std::bad_alloc&) {
    done = true;
    status = absl::ResourceExhaustedError(absl::StrCat("image '", image.name, "': out of memory while decoding"));
  }
  if (done && status.ok()) {
    image.width = png_get_image_width(png, info);
    image.height = png_get_image_height(png, info);
    image.rgba = std::move(rgba);
  }
  png_destroy_read_struct(&png, &info, nullptr);
  return done ? status : Invalid(image, absl::StrCat("broken PNG: ", reader.message));
}

// libjpeg's way out of an error: a jump back into DecodeJpeg.
struct JpegError {
  jpeg_error_mgr base;
  jpeg_progress_mgr progress;
  std::jmp_buf jump;
  char message[JMSG_LENGTH_MAX];
};

void OnJpegError(j_common_ptr info) {
  auto* error = reinterpret_cast<JpegError*>(info->err);
  (*info->err->format_message)(info, error->message);
  std::longjmp(error->jump, 1);
}

// libjpeg fills what a truncated file lacks with gray and only warns; this warning says that texels are missing.
void OnJpegWarning(j_common_ptr info, int) {
  if (info->err->msg_code == JWRN_HIT_MARKER) OnJpegError(info);
}

// A progressive file may repeat tiny scans, each of which costs a pass over all texels.
void CountJpegScans(j_common_ptr info) {
  constexpr int kMaxScans = 500;  // encoders write about 10
  if (reinterpret_cast<jpeg_decompress_struct*>(info)->input_scan_number <= kMaxScans) return;
  auto* error = reinterpret_cast<JpegError*>(info->err);
  std::strcpy(error->message, "more than 500 scans");
  std::longjmp(error->jump, 1);
}

// Decodes rows as RGB into `rgba`, alpha 255. Holds nothing that a jump would leak: `rgba` belongs to the caller.
bool ReadJpeg(jpeg_decompress_struct& jpeg, JpegError& error, const Image& image, const LoadLimits& limits,
              std::vector<uint8_t>& rgba, absl::Status& status) {
  if (setjmp(error.jump) != 0) return false;
  jpeg_create_decompress(&jpeg);
  jpeg_mem_src(&jpeg, image.encoded.data(), image.encoded.size());
  jpeg_read_header(&jpeg, TRUE);
  status = CheckPixels(image, jpeg.image_width, jpeg.image_height, limits);
  if (!status.ok()) return true;
  jpeg.progress = &error.progress;
  jpeg.out_color_space = JCS_RGB;
  jpeg.dct_method = JDCT_ISLOW;
  jpeg_start_decompress(&jpeg);
  rgba.assign(size_t{4} * jpeg.output_width * jpeg.output_height, 255);
  while (jpeg.output_scanline < jpeg.output_height) {
    // The row is decoded into the last three quarters of its place, then spread to RGBA from the front.
    uint8_t* row = rgba.data() + size_t{4} * jpeg.output_width * jpeg.output_scanline;
    uint8_t* packed = row + jpeg.output_width;
    JSAMPROW rows[1] = {packed};
    jpeg_read_scanlines(&jpeg, rows, 1);
    for (JDIMENSION x = 0; x < jpeg.output_width; ++x) {
      const uint8_t r = packed[3 * x], g = packed[3 * x + 1], b = packed[3 * x + 2];
      row[4 * x] = r;
      row[4 * x + 1] = g;
      row[4 * x + 2] = b;
      row[4 * x + 3] = 255;
    }
  }
  jpeg_finish_decompress(&jpeg);
  return true;
}

absl::Status DecodeJpeg(Image& image, const LoadLimits& limits) {
  jpeg_decompress_struct jpeg;
  std::memset(&jpeg, 0, sizeof jpeg);
  JpegError error;
  jpeg.err = jpeg_std_error(&error.base);
  error.base.error_exit = OnJpegError;
  error.base.emit_message = OnJpegWarning;
  std::memset(&error.progress, 0, sizeof error.progress);
  error.progress.progress_monitor = CountJpegScans;
  std::vector<uint8_t> rgba;
  absl::Status status;
  bool done = false;
  try {
    done = ReadJpeg(jpeg, error, image, limits, rgba, status);
  } catch (const std::bad_alloc&) {
    done = true;
    status = absl::ResourceExhaustedError(absl::StrCat("image '", image.name, "': out of memory while decoding"));
  }
  if (done && status.ok()) {
    image.width = jpeg.output_width;
    image.height = jpeg.output_height;
    image.rgba = std::move(rgba);
  }
  jpeg_destroy_decompress(&jpeg);
  return done ? status : Invalid(image, absl::StrCat("broken JPEG: ", error.message));
}

absl::Status DecodeWebp(Image& image, const LoadLimits& limits) {
  const std::optional<WebpSize> size = ReadWebpSize(image.encoded);
  if (!size) return Invalid(image, "broken WebP: its header");
  if (absl::Status s = CheckPixels(image, size->width, size->height, limits); !s.ok()) return s;
  std::vector<uint8_t> rgba(uint64_t{4} * size->width * size->height);
  const JobContext endless;
  if (absl::Status s = DecodeWebp(endless, image.encoded, *size, rgba); !s.ok()) {
    return absl::Status(s.code(), absl::StrCat("image '", image.name, "': ", s.message()));
  }
  image.width = size->width;
  image.height = size->height;
  image.rgba = std::move(rgba);
  return absl::OkStatus();
}

}  // namespace

namespace {

// The fault of an image that has no bytes or is of a format that is not decoded.
std::optional<Warning> FaultOf(const Image& image, size_t index) {
  if (image.fault || !image.rgba.empty()) return image.fault;
  const std::string where = absl::StrCat("image ", index);
  if (image.encoded.empty()) {
    return Warning{WarningCode::kTextureMissing, where, "it has no bytes; the material's factor is used"};
  }
  const ImageKind kind = KindOfImage(image.encoded);
  if (kind.format != ImageFormat::kNone) return std::nullopt;
  return Warning{WarningCode::kTextureUndecodable, where,
                 absl::StrCat(kind.name, " is not decoded; the material's factor is used")};
}

}  // namespace

absl::Status DecodeImage(Image& image, const LoadLimits& limits) {
  if (!image.rgba.empty()) return absl::OkStatus();
  const ImageKind kind = KindOfImage(image.encoded);
  if (kind.format != ImageFormat::kNone) {
    if (absl::Status s = CheckForeignDecoders(); !s.ok()) return s;
  }
  switch (kind.format) {
    case ImageFormat::kPng: return DecodePng(image, limits);
    case ImageFormat::kJpeg: return DecodeJpeg(image, limits);
    case ImageFormat::kWebp: return DecodeWebp(image, limits);
    case ImageFormat::kNone: break;
  }
  return absl::UnimplementedError(absl::StrCat("image '", image.name, "': ", kind.name, " is not decoded"));
}

void CheckImages(const TriangleMesh& mesh) {
  for (size_t i = 0; i < mesh.images.size(); ++i) {
    if (mesh.images[i] != nullptr) mesh.images[i]->fault = FaultOf(*mesh.images[i], i);
  }
}

namespace {

// The textures that `use` samples, each as linear values, as sRGB colours, or both.
struct Sampled {
  std::set<int32_t> linear, srgb;
};

Sampled TexturesSampled(const TriangleMesh& mesh, const TextureUse& use) {
  Sampled sampled;
  const auto add = [&](const TextureRef& ref, std::set<int32_t>& to) {
    if (ref.texture >= 0 && size_t(ref.texture) < mesh.textures.size()) to.insert(ref.texture);
  };
  const std::vector<bool> used = MaterialsInUse(mesh);
  for (size_t i = 0; i < used.size(); ++i) {
    if (!used[i]) continue;
    const Material& material = mesh.materials[i];
    const TextureUse read = TexturesOf(material, use);
    if (read.base_color) add(material.base_color, sampled.srgb);
    if (read.emissive) add(material.emissive, sampled.srgb);
    if (read.metallic_roughness) add(material.metallic_roughness, sampled.linear);
  }
  return sampled;
}

Image* ImageOf(const TriangleMesh& mesh, const Texture& texture) {
  if (texture.image < 0 || size_t(texture.image) >= mesh.images.size()) return nullptr;
  return mesh.images[texture.image].get();
}

// Counts what images take, each once.
class ImageBudget {
 public:
  explicit ImageBudget(const LoadLimits& limits) : limits_(limits) {}

  absl::Status TakeTexels(const Image& image) {
    if (!counted_.insert(&image).second) return absl::OkStatus();
    pixels_ += uint64_t{image.width} * image.height;
    if (pixels_ > limits_.max_total_image_pixels) {
      return absl::ResourceExhaustedError(
          absl::StrCat("the images of the scene have more than ", limits_.max_total_image_pixels, " pixels together"));
    }
    return TakeBytes(uint64_t{image.width} * image.height * 4);
  }
  absl::Status TakeMips(const Image& image, const std::vector<Vec4f>& mips) {
    if (!counted_.insert(&mips).second) return absl::OkStatus();
    return TakeBytes(LevelOffset(image.width, image.height, CountLevels(image.width, image.height)) * sizeof(Vec4f));
  }

 private:
  absl::Status TakeBytes(uint64_t bytes) {
    bytes_ += bytes;
    if (bytes_ <= limits_.max_decoded_bytes) return absl::OkStatus();
    return absl::ResourceExhaustedError(absl::StrCat("the images of the scene and their smaller levels take more than ",
                                                     limits_.max_decoded_bytes, " bytes together"));
  }

  const LoadLimits& limits_;
  std::set<const void*> counted_;
  uint64_t pixels_ = 0, bytes_ = 0;
};

absl::Status PrepareTexture(const TriangleMesh& mesh, const Texture& texture, bool srgb, ImageBudget& budget,
                            const LoadLimits& limits) {
  Image* image = ImageOf(mesh, texture);
  if (image == nullptr) return absl::OkStatus();
  image->fault = FaultOf(*image, size_t(texture.image));
  if (image->fault) return absl::OkStatus();  // the factor alone is used
  absl::Status s = DecodeImage(*image, limits);
  if (!s.ok()) return s;
  if (s = budget.TakeTexels(*image); !s.ok()) return s;
  std::vector<Vec4f>& mips = srgb ? image->srgb_mips : image->linear_mips;
  if (texture.mip_filter == MipFilter::kNone) return absl::OkStatus();
  if (s = budget.TakeMips(*image, mips); !s.ok() || !mips.empty()) return s;
  try {
    mips = BuildMips(image->rgba.data(), image->width, image->height, srgb);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(
        absl::StrCat("image '", image->name, "': out of memory for its smaller levels"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status PrepareTextures(TriangleMesh& mesh, const LoadLimits& limits, const TextureUse& use) {
  const Sampled sampled = TexturesSampled(mesh, use);
  ImageBudget budget(limits);
  for (const bool srgb : {true, false}) {
    for (const int32_t t : srgb ? sampled.srgb : sampled.linear) {
      if (absl::Status s = PrepareTexture(mesh, mesh.textures[t], srgb, budget, limits); !s.ok()) return s;
    }
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe
