#include "encode/encode.h"

#include <new>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "encode/atomic_file.h"
#include "encode/npy.h"
#include "encode/png_preview.h"

namespace voxelpipe {
namespace {

absl::Status WriteTargets(const VoxelizeResult& result, const std::string& path, bool npy, const JobContext* job) {
  const std::vector<std::string> paths = OutputPaths(path, result.targets.size());
  for (size_t i = 0; i < result.targets.size(); ++i) {
    absl::StatusOr<AtomicFile> file = AtomicFile::Create(paths[i]);
    if (!file.ok()) return file.status();
    absl::Status status = npy ? WriteNpy(result, i, *file, job) : file->Write(result.targets[i].bytes(), job);
    if (status.ok()) status = file->Commit();
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

}  // namespace

std::string FileExtension(std::string_view path) {
  const size_t slash = path.rfind('/');
  const std::string_view name = slash == std::string_view::npos ? path : path.substr(slash + 1);
  const size_t dot = name.rfind('.');
  if (dot == std::string_view::npos || dot == 0) return "";  // no dot, or a hidden file without an extension
  return absl::AsciiStrToLower(std::string(name.substr(dot)));
}

bool IsKnownExtension(std::string_view extension) {
  return extension == ".raw" || extension == ".npy" || extension == ".png";
}

std::vector<std::string> OutputPaths(const std::string& path, size_t target_count) {
  const std::string extension = FileExtension(path);
  if (target_count <= 1 || extension == ".png") return {path};
  const std::string stem = path.substr(0, path.size() - extension.size());
  const std::string written_extension = path.substr(stem.size());  // keeps the caller's upper or lower case
  std::vector<std::string> paths;
  for (size_t i = 0; i < target_count; ++i) paths.push_back(absl::StrCat(stem, ".", i, written_extension));
  return paths;
}

absl::Status WriteResult(const VoxelizeResult& result, const std::string& path, const JobContext* job) {
  const std::string extension = FileExtension(path);
  try {
    if (extension == ".npy" || extension == ".raw") return WriteTargets(result, path, extension == ".npy", job);
    if (extension == ".png") return WritePreview(result, path, {}, job);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(absl::StrCat("out of memory while writing '", path, "'"));
  }
  return absl::InvalidArgumentError(
      absl::StrCat("'", path, "': no writer for '", extension, "'; known extensions are .raw, .npy and .png"));
}

}  // namespace voxelpipe
