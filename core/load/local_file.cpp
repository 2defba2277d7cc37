#include "load/local_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <climits>
#include <new>
#include <optional>
#include <span>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "base/text.h"
#include "load/base/text_reader.h"

namespace voxelpipe {
namespace {

namespace fs = std::filesystem;

int HexValue(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

std::optional<std::string> PercentDecode(const std::string& uri) {
  std::string out;
  for (size_t i = 0; i < uri.size(); ++i) {
    if (uri[i] != '%') {
      out += uri[i];
      continue;
    }
    if (i + 2 >= uri.size() || HexValue(uri[i + 1]) < 0 || HexValue(uri[i + 2]) < 0) return std::nullopt;
    out += char(HexValue(uri[i + 1]) * 16 + HexValue(uri[i + 2]));
    i += 2;
  }
  return out;
}

// "scheme:" before any slash.
bool HasScheme(const std::string& uri) {
  const size_t colon = uri.find(':');
  return colon != std::string::npos && uri.find('/') > colon;
}

bool IsInside(const fs::path& directory, const fs::path& file) {
  return std::mismatch(directory.begin(), directory.end(), file.begin(), file.end()).first == directory.end();
}

// The first link on the path from `root` to a file.
std::optional<fs::path> FirstLink(const fs::path& root, const fs::path& relative) {
  fs::path at = root;
  for (const fs::path& part : relative) {
    at /= part;
    std::error_code ignored;
    if (fs::is_symlink(at, ignored)) return at.lexically_normal();
  }
  return std::nullopt;
}

absl::Status ReadError(int error) {
  if (error == ENOENT || error == ENOTDIR) return absl::NotFoundError("no such file");
  return absl::ErrnoToStatus(error, "cannot be read");
}

absl::Status ReadAll(int descriptor, std::span<uint8_t> bytes) {
  while (!bytes.empty()) {
    const ssize_t got = read(descriptor, bytes.data(), bytes.size());
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return ReadError(errno);
    if (got == 0) return absl::DataLossError("cannot be read to its end: it became shorter meanwhile");
    bytes = bytes.subspan(size_t(got));
  }
  return absl::OkStatus();
}

// In: a path as the file of the format `of` has it. Errors begin with `shown`.
absl::StatusOr<SiblingFile> Resolve(const fs::path& directory, const std::string& path, const std::string& shown,
                                    const char* of) {
  const auto invalid = [&](const char* why) { return absl::InvalidArgumentError(absl::StrCat(shown, ": ", why)); };
  if (path.empty()) return invalid("empty");
  if (path.size() > PATH_MAX) return invalid("longer than a path may be");
  if (path.find('\0') != std::string::npos) return invalid("a zero byte is no part of a path");
  if (fs::path(path).is_absolute()) return invalid("absolute paths are not read");
  std::error_code error;
  const fs::path root = fs::weakly_canonical(directory.empty() ? "." : directory, error);
  if (error) return invalid("its directory cannot be resolved");
  SiblingFile file{fs::weakly_canonical(root / path, error), ""};
  if (error) return invalid("cannot be resolved");
  if (IsInside(root, file.path)) return file;
  if (const std::optional<fs::path> link = FirstLink(root, path)) {
    file.outside = absl::StrCat("the link '", link->string(), "' leads out of the directory of the ", of, " file");
  } else {
    file.outside = absl::StrCat("leaves the directory of the ", of, " file");
  }
  absl::StrAppend(&file.outside, ", to '", file.path.string(), "'");
  return file;
}

}  // namespace

absl::StatusOr<FileBytes> ReadLocalFile(const fs::path& path, uint64_t max_bytes) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0) return ReadError(errno);
  if (!S_ISREG(status.st_mode)) return absl::InvalidArgumentError("not a regular file");
  const auto size = uint64_t(status.st_size);
  if (size > max_bytes) {
    return absl::ResourceExhaustedError(absl::StrCat("has ", BytesText(size), "; the limit is ", BytesText(max_bytes)));
  }
  FileBytes bytes;
  try {
    bytes.resize(size);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(absl::StrCat("no memory for ", BytesText(size)));
  }
  const int descriptor = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor < 0) return ReadError(errno);
  absl::Status read = ReadAll(descriptor, bytes);
  close(descriptor);
  if (!read.ok()) return read;
  return bytes;
}

absl::StatusOr<FileBytes> ReadSibling(const fs::path& path, uint64_t max_bytes, MemoryCharge& charge) {
  std::error_code error;
  const uint64_t bytes = fs::file_size(path, error);
  if (!error && bytes <= max_bytes) {  // otherwise reading it fails
    if (absl::Status full = charge.Grow(bytes, "a file that the mesh file names:"); !full.ok()) return full;
  }
  return ReadLocalFile(path, max_bytes);
}

std::string UriName(const std::string& uri) {
  constexpr size_t kMaxBytes = 120;
  std::string shown = uri.substr(0, kMaxBytes);
  std::replace_if(
      shown.begin(), shown.end(), [](unsigned char c) { return std::iscntrl(c) != 0; }, '?');
  return absl::StrCat("URI '", shown, uri.size() > kMaxBytes ? "..." : "", "'");
}

absl::StatusOr<SiblingFile> ResolveSibling(const fs::path& directory, const std::string& uri) {
  const auto invalid = [&](const char* why) {
    return absl::InvalidArgumentError(absl::StrCat(UriName(uri), ": ", why));
  };
  if (HasScheme(uri)) return invalid("only data: URIs and files beside the glTF file are read");
  const std::optional<std::string> decoded = PercentDecode(uri);
  if (!decoded) return invalid("broken percent-encoding");
  if (decoded->find('\\') != std::string::npos) return invalid("a backslash is no part of a path");
  return Resolve(directory, *decoded, UriName(uri), "glTF");
}

absl::StatusOr<SiblingFile> ResolveSiblingName(const fs::path& directory, const std::string& name) {
  std::string path = name;
  std::replace(path.begin(), path.end(), '\\', '/');
  if (path.size() > 1 && path[1] == ':') path.insert(0, "/");  // a drive: absolute
  return Resolve(directory, path, absl::StrCat("the file ", Quote(name)), "OBJ");
}

}  // namespace voxelpipe
