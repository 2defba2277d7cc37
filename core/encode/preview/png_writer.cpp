#include "encode/preview/png_writer.h"

#include <png.h>
#include <stdio.h>

#include "absl/strings/str_cat.h"
#include "job/job_work.h"

namespace voxelpipe {
namespace {

png_image ImageOf(int width, int height) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  image.width = static_cast<png_uint_32>(width);
  image.height = static_cast<png_uint_32>(height);
  image.format = PNG_FORMAT_RGB;
  image.flags = PNG_IMAGE_FLAG_FAST;  // a sixth of the time of the default, for files that are a sixth larger
  return image;
}

// A stream into `bytes` that fails at the end of the job.
struct Output {
  const JobContext* job;
  std::vector<uint8_t> bytes;
};

ssize_t Append(void* cookie, const char* data, size_t size) {
  auto& output = *static_cast<Output*>(cookie);
  if (!CheckJob(output.job).ok() || size > output.bytes.capacity() - output.bytes.size()) return 0;
  output.bytes.insert(output.bytes.end(), data, data + size);
  return ssize_t(size);
}

}  // namespace

uint64_t PngMemoryBytes(int width, int height) {
  constexpr uint64_t kLibrary = 512 << 10;  // zlib's window, and rows
  const png_image image = ImageOf(width, height);
  return PNG_IMAGE_PNG_SIZE_MAX(image) + kLibrary;
}

absl::StatusOr<std::vector<uint8_t>> EncodePng(const Picture& picture, const JobContext* job) {
  // libpng's simplified interface: no setjmp, errors come back in the image structure.
  png_image image = ImageOf(picture.width, picture.height);
  Output output{job, {}};
  output.bytes.reserve(PNG_IMAGE_PNG_SIZE_MAX(image));
  FILE* const stream =
      fopencookie(&output, "wb", {.read = nullptr, .write = &Append, .seek = nullptr, .close = nullptr});
  if (stream == nullptr) return absl::ResourceExhaustedError("out of memory while encoding a picture");
  const bool written = png_image_write_to_stdio(&image, stream, 0, picture.rgb.data(), 0, nullptr) != 0;
  const bool closed = fclose(stream) == 0;
  if (absl::Status s = CheckJob(job); !s.ok()) return s;
  if (!written || !closed) {
    return absl::InternalError(absl::StrCat("libpng cannot encode the picture: ", image.message));
  }
  return std::move(output.bytes);
}

}  // namespace voxelpipe
