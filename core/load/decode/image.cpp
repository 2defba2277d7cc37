#include "load/decode/image.h"

#include <cstdio>  // jpeglib.h needs FILE

#include <jerror.h>
#include <jpeglib.h>
#include <png.h>

#include <algorithm>
#include <csetjmp>
#include <cstring>
#include <new>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "load/decode/foreign_decoders.h"
#include "load/decode/image_format.h"
#include "load/decode/image_webp.h"
#include "load/decode/mips.h"
#include "mesh/texture_faults.h"
#include "mesh/views/mips.h"

namespace voxelpipe {
namespace {

absl::Status Invalid(const Image& image, const std::string& why) {
  return absl::InvalidArgumentError(absl::StrCat("image '", image.name, "': ", why));
}

// The state of decoding one image.
struct Decoding {
  const JobContext& job;
  const LoadLimits& limits;
  MemoryCharge texels;   // kept with the image
  MemoryCharge working;  // released with the decoder
  absl::Status status;   // why the decoder was stopped: by the job, a limit or memory

  bool Allow(absl::Status why) {
    if (status.ok()) status = std::move(why);
    return status.ok();
  }
};

absl::Status CheckPixels(const Image& image, uint64_t width, uint64_t height, const LoadLimits& limits) {
  if (width == 0 || height == 0) return Invalid(image, "has no pixels");
  if (width > limits.max_image_edge || height > limits.max_image_edge) {
    return absl::ResourceExhaustedError(absl::StrCat("image '", image.name, "': ", width, " x ", height,
                                                     " pixels, the limit of an edge is ", limits.max_image_edge,
                                                     " pixels"));
  }
  if (width * height > limits.max_image_pixels) {  // both are 32-bit
    return absl::ResourceExhaustedError(absl::StrCat("image '", image.name, "': ", width, " x ", height,
                                                     " pixels, the limit is ", limits.max_image_pixels, " pixels"));
  }
  return absl::OkStatus();
}

// Charges the texels to the job's memory and allocates them in steps, because writing fresh pages takes long.
absl::Status TakeTexels(const Image& image, uint64_t width, uint64_t height, Decoding& decoding,
                        std::vector<uint8_t>& rgba) {
  if (absl::Status s = CheckPixels(image, width, height, decoding.limits); !s.ok()) return s;
  const uint64_t bytes = width * height * 4;
  if (absl::Status s = decoding.texels.Grow(bytes, "image '" + image.name + "':"); !s.ok()) return s;
  constexpr uint64_t kStepBytes = 1 << 20;
  rgba.reserve(bytes);
  while (rgba.size() < bytes) {
    if (absl::Status s = decoding.job.Check(); !s.ok()) return s;
    rgba.resize(std::min(bytes, rgba.size() + kStepBytes));
  }
  return absl::OkStatus();
}

struct PngReader {
  std::span<const uint8_t> left;  // bytes not read yet
  std::string message;
  Decoding& decoding;
};

void OnPngError(png_structp png, png_const_charp message) {
  static_cast<PngReader*>(png_get_error_ptr(png))->message = message;
  png_longjmp(png, 1);
}

void OnPngWarning(png_structp, png_const_charp) {}

void ReadPngBytes(png_structp png, png_bytep out, size_t count) {
  auto& reader = *static_cast<PngReader*>(png_get_io_ptr(png));
  auto& left = reader.left;
  if (!reader.decoding.Allow(reader.decoding.job.Check())) png_error(png, "the job is over");
  if (count > left.size()) png_error(png, "the data ends too early");
  std::memcpy(out, left.data(), count);
  left = left.subspan(count);
}

// Decodes to 8-bit RGBA. glTF ignores colour profiles and gamma, hence not libpng's simplified interface, which applies
// them. Holds nothing that a jump would leak. Out: false after a jump, or with decoding.status.
bool ReadPng(png_structp png, png_infop info, const Image& image, Decoding& decoding, std::vector<uint8_t>& rgba) {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_read_info(png, info);
  const uint64_t width = png_get_image_width(png, info), height = png_get_image_height(png, info);
  if (!decoding.Allow(TakeTexels(image, width, height, decoding, rgba))) return false;
  png_set_expand(png);
  png_set_scale_16(png);
  png_set_gray_to_rgb(png);
  png_set_add_alpha(png, 255, PNG_FILLER_AFTER);
  const int passes = png_set_interlace_handling(png);
  png_read_update_info(png, info);
  for (int pass = 0; pass < passes; ++pass) {
    for (uint64_t y = 0; y < height; ++y) {
      if (!decoding.Allow(decoding.job.Check())) return false;
      png_read_row(png, rgba.data() + size_t{4} * width * y, nullptr);
    }
  }
  return true;
}

absl::Status DecodePng(Image& image, Decoding& decoding, std::vector<uint8_t>& rgba) {
  PngReader reader{image.encoded, "", decoding};
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &reader, OnPngError, OnPngWarning);
  png_infop info = png == nullptr ? nullptr : png_create_info_struct(png);
  if (info == nullptr) {
    png_destroy_read_struct(&png, nullptr, nullptr);
    return absl::ResourceExhaustedError(absl::StrCat("image '", image.name, "': out of memory while decoding"));
  }
  png_set_read_fn(png, &reader, ReadPngBytes);
  png_set_user_limits(png, 0x7fffffff, 0x7fffffff);  // the pixel limit is ours, below
  png_set_chunk_cache_max(png, 1);  // none: compressed text may expand a thousandfold, and is not used here
  bool done = false;
  try {
    done = ReadPng(png, info, image, decoding, rgba);
  } catch (const std::bad_alloc&) {
    decoding.Allow(
        absl::ResourceExhaustedError(absl::StrCat("image '", image.name, "': out of memory while decoding")));
  }
  if (done) {
    image.width = png_get_image_width(png, info);
    image.height = png_get_image_height(png, info);
  }
  png_destroy_read_struct(&png, &info, nullptr);
  if (!decoding.status.ok()) return decoding.status;
  return done ? absl::OkStatus() : Invalid(image, absl::StrCat("broken PNG: ", reader.message));
}

// libjpeg's error exit: a longjmp back into DecodeJpeg.
struct JpegError {
  jpeg_error_mgr base;
  jpeg_progress_mgr progress;
  std::jmp_buf jump;
  char message[JMSG_LENGTH_MAX];
  Decoding* decoding;
};

void OnJpegError(j_common_ptr info) {
  auto* error = reinterpret_cast<JpegError*>(info->err);
  (*info->err->format_message)(info, error->message);
  std::longjmp(error->jump, 1);
}

// libjpeg fills the missing rows of a truncated file with gray and only warns; this is its warning.
void OnJpegWarning(j_common_ptr info, int) {
  if (info->err->msg_code == JWRN_HIT_MARKER) OnJpegError(info);
}

// Called for each row of blocks of each scan. A progressive file may contain many tiny scans, each of which costs a
// pass over all texels.
void OnJpegProgress(j_common_ptr info) {
  constexpr int kMaxScans = 500;                      // encoders write about 10
  constexpr uint64_t kMaxScannedTexels = 1ull << 30;  // of all scans together: 16 of the largest image
  auto* error = reinterpret_cast<JpegError*>(info->err);
  const auto* jpeg = reinterpret_cast<jpeg_decompress_struct*>(info);
  const uint64_t texels = uint64_t{jpeg->image_width} * jpeg->image_height;
  if (jpeg->input_scan_number > kMaxScans) {
    std::strcpy(error->message, "more than 500 scans");
  } else if (uint64_t(jpeg->input_scan_number) * texels > std::max(kMaxScannedTexels, texels)) {
    std::strcpy(error->message, "more scans than encoders write for an image of this size");
  } else if (error->decoding->Allow(error->decoding->job.Check())) {
    return;
  }
  std::longjmp(error->jump, 1);
}

// Files of several scans are held as coefficients until the last one is read.
uint64_t CoefficientBytes(jpeg_decompress_struct& jpeg) {
  if (!jpeg_has_multiple_scans(&jpeg)) return 0;
  uint64_t blocks = 0;
  for (int c = 0; c < jpeg.num_components; ++c) {
    blocks += uint64_t{jpeg.comp_info[c].width_in_blocks} * jpeg.comp_info[c].height_in_blocks;
  }
  return blocks * sizeof(JBLOCK);
}

// Decodes rows as RGB into `rgba`, alpha 255. Holds nothing that a jump would leak: `rgba` belongs to the caller.
bool ReadJpeg(jpeg_decompress_struct& jpeg, JpegError& error, const Image& image, Decoding& decoding,
              std::vector<uint8_t>& rgba) {
  if (setjmp(error.jump) != 0) return false;
  jpeg_create_decompress(&jpeg);
  jpeg_mem_src(&jpeg, image.encoded.data(), image.encoded.size());
  jpeg_read_header(&jpeg, TRUE);
  if (!decoding.Allow(TakeTexels(image, jpeg.image_width, jpeg.image_height, decoding, rgba))) return false;
  if (!decoding.Allow(decoding.working.Grow(CoefficientBytes(jpeg), "image '" + image.name + "':"))) return false;
  jpeg.progress = &error.progress;
  jpeg.out_color_space = JCS_RGB;
  jpeg.dct_method = JDCT_ISLOW;
  jpeg_start_decompress(&jpeg);
  while (jpeg.output_scanline < jpeg.output_height) {
    if (!decoding.Allow(decoding.job.Check())) return false;
    // The row is decoded into the last three quarters of its memory, then expanded to RGBA from the front.
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

absl::Status DecodeJpeg(Image& image, Decoding& decoding, std::vector<uint8_t>& rgba) {
  jpeg_decompress_struct jpeg;
  std::memset(&jpeg, 0, sizeof jpeg);
  JpegError error;
  error.decoding = &decoding;
  jpeg.err = jpeg_std_error(&error.base);
  error.base.error_exit = OnJpegError;
  error.base.emit_message = OnJpegWarning;
  std::memset(&error.progress, 0, sizeof error.progress);
  error.progress.progress_monitor = OnJpegProgress;
  bool done = false;
  try {
    done = ReadJpeg(jpeg, error, image, decoding, rgba);
  } catch (const std::bad_alloc&) {
    decoding.Allow(
        absl::ResourceExhaustedError(absl::StrCat("image '", image.name, "': out of memory while decoding")));
  }
  if (done) {
    image.width = jpeg.output_width;
    image.height = jpeg.output_height;
  }
  jpeg_destroy_decompress(&jpeg);
  if (!decoding.status.ok()) return decoding.status;
  return done ? absl::OkStatus() : Invalid(image, absl::StrCat("broken JPEG: ", error.message));
}

// Adds a charge to that of the image.
void Keep(MemoryCharge charge, Image& image) {
  if (image.memory == nullptr) {
    image.memory = std::make_shared<MemoryCharge>(std::move(charge));
  } else {
    image.memory->Absorb(std::move(charge));
  }
}

absl::Status DecodeWebp(Image& image, Decoding& decoding, std::vector<uint8_t>& rgba) {
  const std::optional<WebpSize> size = ReadWebpSize(image.encoded);
  if (!size) return Invalid(image, "broken WebP: its header");
  if (absl::Status s = TakeTexels(image, size->width, size->height, decoding, rgba); !s.ok()) return s;
  if (absl::Status s = decoding.working.Grow(size->working_bytes, "image '" + image.name + "':"); !s.ok()) return s;
  if (absl::Status s = DecodeWebp(decoding.job, image.encoded, *size, rgba); !s.ok()) {
    return WithText(s, absl::StrCat("image '", image.name, "': ", s.message()));
  }
  image.width = size->width;
  image.height = size->height;
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

absl::Status DecodeImage(const JobContext& job, Image& image, const LoadLimits& limits) {
  if (!image.rgba.empty()) return absl::OkStatus();
  const ImageKind kind = KindOfImage(image.encoded);
  if (kind.format != ImageFormat::kNone) {
    if (absl::Status s = CheckForeignDecoders(); !s.ok()) return s;
  }
  Decoding decoding{job, limits, MemoryCharge(&MemoryOf(job)), MemoryCharge(&MemoryOf(job)), absl::OkStatus()};
  std::vector<uint8_t> rgba;
  absl::Status decoded;
  switch (kind.format) {
    case ImageFormat::kPng: decoded = DecodePng(image, decoding, rgba); break;
    case ImageFormat::kJpeg: decoded = DecodeJpeg(image, decoding, rgba); break;
    case ImageFormat::kWebp: decoded = DecodeWebp(image, decoding, rgba); break;
    case ImageFormat::kNone:
      return absl::UnimplementedError(absl::StrCat("image '", image.name, "': ", kind.name, " is not decoded"));
  }
  if (!decoded.ok()) return decoded;
  image.rgba = std::move(rgba);
  Keep(std::move(decoding.texels), image);
  return absl::OkStatus();
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

// Counts the texels of images, each image once.
class PixelCount {
 public:
  explicit PixelCount(const LoadLimits& limits) : limits_(limits) {}

  absl::Status Add(const Image& image) {
    if (!counted_.insert(&image).second) return absl::OkStatus();
    pixels_ += uint64_t{image.width} * image.height;
    if (pixels_ <= limits_.max_total_image_pixels) return absl::OkStatus();
    return absl::ResourceExhaustedError(
        absl::StrCat("the images of the scene have more than ", limits_.max_total_image_pixels, " pixels together"));
  }

 private:
  const LoadLimits& limits_;
  std::set<const Image*> counted_;
  uint64_t pixels_ = 0;
};

absl::Status PrepareTexture(const JobContext& job, const TriangleMesh& mesh, const Texture& texture, bool srgb,
                            PixelCount& pixels, const LoadLimits& limits) {
  Image* image = ImageOf(mesh, texture);
  if (image == nullptr) return absl::OkStatus();
  image->fault = FaultOf(*image, size_t(texture.image));
  if (image->fault) return absl::OkStatus();  // only the factor is used
  absl::Status s = DecodeImage(job, *image, limits);
  if (!s.ok()) return s;
  if (s = pixels.Add(*image); !s.ok()) return s;
  std::vector<Vec4f>& mips = srgb ? image->srgb_mips : image->linear_mips;
  if (texture.mip_filter == MipFilter::kNone || !mips.empty()) return absl::OkStatus();
  MemoryCharge charge(&MemoryOf(job));
  const uint64_t texels = LevelOffset(image->width, image->height, CountLevels(image->width, image->height));
  s = charge.Grow(texels, sizeof(Vec4f), "image '" + image->name + "', smaller levels:");
  if (!s.ok()) return s;
  try {
    absl::StatusOr<std::vector<Vec4f>> made = BuildMips(job, image->rgba.data(), image->width, image->height, srgb);
    if (!made.ok()) return made.status();
    mips = *std::move(made);
    Keep(std::move(charge), *image);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(
        absl::StrCat("image '", image->name, "': out of memory for its smaller levels"));
  }
  return absl::OkStatus();
}

}  // namespace

absl::Status PrepareTextures(TriangleMesh& mesh, const LoadLimits& limits, const TextureUse& use) {
  const JobContext endless;
  return PrepareTexturesFor(endless, mesh, limits, use);
}

absl::Status PrepareTexturesFor(const JobContext& job, TriangleMesh& mesh, const LoadLimits& limits,
                                const TextureUse& use) {
  const Sampled sampled = TexturesSampled(mesh, use);
  PixelCount pixels(limits);
  for (const bool srgb : {true, false}) {
    for (const int32_t t : srgb ? sampled.srgb : sampled.linear) {
      if (absl::Status s = PrepareTexture(job, mesh, mesh.textures[t], srgb, pixels, limits); !s.ok()) return s;
    }
  }
  return absl::OkStatus();
}

}  // namespace voxelpipe
