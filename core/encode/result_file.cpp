#include "encode/result_file.h"

#include "absl/strings/str_cat.h"
#include "encode/encode.h"
#include "encode/format_registry.h"

namespace voxelpipe {
namespace {

bool HasWriter(const OutputFormat& format) {
  return !format.picture();
}

}  // namespace

absl::StatusOr<std::unique_ptr<ResultFile>> OpenResultFile(const std::string& path, const JobContext* job) {
  const std::string extension = FileExtension(path);
  const OutputFormat* const format = FindFormat(extension);
  if (format != nullptr && !format->picture()) return format->open(path, job);
  return absl::InvalidArgumentError(absl::StrCat("'", path, "': no writer for '", extension, "'; known extensions are ",
                                                 ListFormats(true, &HasWriter)));
}

absl::StatusOr<std::unique_ptr<ResultFile>> OpenStandardOutput(const std::string& extension, const JobContext* job) {
  const OutputFormat* const format = FindFormat(extension);
  if (format != nullptr && !format->picture() && format->standard_output) return format->open("", job);
  return absl::InvalidArgumentError(absl::StrCat("standard output: no writer for '", extension, "'"));
}

}  // namespace voxelpipe
