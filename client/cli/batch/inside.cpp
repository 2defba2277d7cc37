#include "batch/inside.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "encode/output_path.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;

bool IsBelow(const fs::path& directory, const fs::path& file) {
  return std::mismatch(directory.begin(), directory.end(), file.begin(), file.end()).first == directory.end();
}

// The outermost link on the path from `root` to `path`, for the error.
std::string FirstLink(const fs::path& root, const fs::path& path) {
  fs::path at = root;
  for (const fs::path& part : path.lexically_relative(root)) {
    at /= part;
    std::error_code ignored;
    if (fs::is_symlink(at, ignored)) return at.string();
  }
  return path.string();
}

}  // namespace

absl::Status CheckInside(const std::string& output_dir, const std::string& path) {
  const absl::StatusOr<std::string> file = FollowLinks(path);
  if (!file.ok()) return file.status();
  std::error_code error;
  const fs::path root = fs::weakly_canonical(output_dir, error);
  const fs::path directory = error ? fs::path() : fs::weakly_canonical(fs::path(*file).parent_path(), error);
  if (error) return absl::ErrnoToStatus(error.value(), absl::StrCat("cannot create '", path, "'"));
  const fs::path whole = directory / fs::path(*file).filename();
  if (!IsBelow(root, directory)) {
    return absl::PermissionDeniedError(absl::StrCat("'", FirstLink(output_dir, path), "' is a link that leads out of '",
                                                    output_dir, "', to '", whole.string(),
                                                    "'; batch does not follow it"));
  }
  const fs::file_type type = fs::status(whole, error).type();
  if (type == fs::file_type::not_found || type == fs::file_type::regular || type == fs::file_type::directory) {
    return absl::OkStatus();
  }
  return absl::FailedPreconditionError(
      absl::StrCat("'", path, "' is not a regular file; batch writes only regular files"));
}

}  // namespace voxelpipe::cli
