#include "encode/output_path.h"

#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <filesystem>

#include "absl/status/status.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "base/checksum/crc32c.h"

namespace voxelpipe {

absl::StatusOr<std::string> FollowLinks(const std::string& path) {
  constexpr int kMaxLinks = 40;  // Linux's own bound
  std::string at = path;
  for (int links = 0; links < kMaxLinks; ++links) {
    struct stat status {};
    if (lstat(at.c_str(), &status) != 0 || !S_ISLNK(status.st_mode))
      return at;  // creating the file reports what is wrong
    char target[PATH_MAX];
    const ssize_t length = readlink(at.c_str(), target, sizeof target);
    if (length < 0) return absl::ErrnoToStatus(errno, absl::StrCat("cannot follow the link '", at, "'"));
    at = (std::filesystem::path(at).parent_path() / std::string(target, size_t(length))).string();
  }
  return absl::ErrnoToStatus(ELOOP, absl::StrCat("cannot follow the link '", path, "'"));
}

std::string FitFileName(const std::string& path, size_t appended_bytes) {
  constexpr size_t kMaxNameBytes = 255, kMarkBytes = 9;
  const size_t slash = path.rfind('/');
  const size_t begin = slash == std::string::npos ? 0 : slash + 1;
  if (path.size() - begin + appended_bytes <= kMaxNameBytes) return path;
  size_t end = begin + kMaxNameBytes - kMarkBytes - appended_bytes;
  while (end > begin && (path[end] & 0xC0) == 0x80) --end;  // not within a character of UTF-8
  const auto* name = reinterpret_cast<const uint8_t*>(path.data() + begin);
  return absl::StrCat(path.substr(0, end), absl::StrFormat("~%08x", Crc32c({name, path.size() - begin})));
}

}  // namespace voxelpipe
