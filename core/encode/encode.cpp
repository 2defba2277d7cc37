#include "encode/encode.h"

#include <new>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "encode/format_registry.h"
#include "encode/png_preview.h"
#include "encode/raw_description.h"
#include "encode/result_file.h"

namespace voxelpipe {

std::string FileExtension(std::string_view path) {
  const size_t slash = path.rfind('/');
  const std::string_view name = slash == std::string_view::npos ? path : path.substr(slash + 1);
  const std::string lower = absl::AsciiStrToLower(std::string(name));
  if (const std::string_view known = FormatExtensionOf(lower); !known.empty()) return std::string(known);
  const size_t dot = lower.rfind('.');
  if (dot == std::string::npos || dot == 0) return "";  // no dot, or a hidden file without an extension
  return lower.substr(dot);
}

bool IsKnownExtension(std::string_view extension) {
  return FindFormat(extension) != nullptr;
}

std::vector<std::string> OutputPaths(const std::string& path, size_t target_count) {
  const std::string extension = FileExtension(path);
  const OutputFormat* const format = FindFormat(extension);
  if (target_count <= 1 || format == nullptr || format->targets != TargetPlaces::kFileEach) return {path};
  const std::string stem = path.substr(0, path.size() - extension.size());
  const std::string written_extension = path.substr(stem.size());  // keeps the caller's upper or lower case
  std::vector<std::string> paths;
  for (size_t i = 0; i < target_count; ++i) paths.push_back(absl::StrCat(stem, ".", i, written_extension));
  return paths;
}

std::vector<std::string> WrittenPaths(const std::string& path, size_t target_count) {
  std::vector<std::string> paths = OutputPaths(path, target_count);
  if (FileExtension(path) == ".raw") paths.push_back(RawDescriptionPath(path));
  return paths;
}

absl::Status WriteResult(const VoxelizeResult& result, const std::string& path, const JobContext* job) {
  try {
    if (FileExtension(path) == ".png") return WritePreview(result, path, {}, job);
    absl::StatusOr<std::unique_ptr<ResultFile>> file = OpenResultFile(path, job);
    if (!file.ok()) return file.status();
    if (absl::Status s = WriteTo(result, **file); !s.ok()) return s;
    return (*file)->Commit();
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(absl::StrCat("out of memory while writing '", path, "'"));
  }
}

}  // namespace voxelpipe
