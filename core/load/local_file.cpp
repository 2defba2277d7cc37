#include "load/local_file.h"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <new>
#include <optional>
#include <system_error>

#include "absl/strings/str_cat.h"

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

std::string Shown(const std::string& uri) {
  std::string shown = uri.substr(0, 120);
  std::replace_if(
      shown.begin(), shown.end(), [](unsigned char c) { return std::iscntrl(c) != 0; }, '?');
  return shown;
}

}  // namespace

absl::StatusOr<FileBytes> ReadLocalFile(const fs::path& path, uint64_t max_bytes) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  if (!fs::exists(status)) return absl::NotFoundError(absl::StrCat(path.string(), ": no such file"));
  if (!fs::is_regular_file(status))
    return absl::InvalidArgumentError(absl::StrCat(path.string(), ": not a regular file"));
  const uint64_t size = fs::file_size(path, error);
  if (error) return absl::InvalidArgumentError(absl::StrCat(path.string(), ": ", error.message()));
  if (size > max_bytes) {
    return absl::ResourceExhaustedError(
        absl::StrCat(path.string(), ": ", size, " bytes, the limit is ", max_bytes, " bytes"));
  }
  FileBytes bytes;
  try {
    bytes.resize(size);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError(absl::StrCat(path.string(), ": no memory for ", size, " bytes"));
  }
  std::ifstream file(path, std::ios::binary);
  file.read(reinterpret_cast<char*>(bytes.data()), std::streamsize(size));
  if (!file || uint64_t(file.gcount()) != size) {
    return absl::InvalidArgumentError(absl::StrCat(path.string(), ": cannot be read"));
  }
  return bytes;
}

absl::StatusOr<fs::path> ResolveSibling(const fs::path& directory, const std::string& uri) {
  const auto invalid = [&](const char* why) {
    return absl::InvalidArgumentError(absl::StrCat("URI '", Shown(uri), "': ", why));
  };
  if (HasScheme(uri)) return invalid("only data: URIs and files beside the glTF file are read");
  const std::optional<std::string> decoded = PercentDecode(uri);
  if (!decoded) return invalid("broken percent-encoding");
  if (decoded->empty()) return invalid("empty");
  if (decoded->find('\0') != std::string::npos || decoded->find('\\') != std::string::npos) {
    return invalid("a backslash or a zero byte is no part of a path");
  }
  if (fs::path(*decoded).is_absolute()) return invalid("absolute paths are not read");
  std::error_code error;
  const fs::path root = fs::weakly_canonical(directory.empty() ? "." : directory, error);
  if (error) return invalid("its directory cannot be resolved");
  const fs::path file = fs::weakly_canonical(root / *decoded, error);
  if (error) return invalid("cannot be resolved");
  if (!IsInside(root, file)) return invalid("leaves the directory of the glTF file");
  if (!fs::exists(file, error)) return absl::NotFoundError(absl::StrCat("URI '", Shown(uri), "': no such file"));
  return file;
}

}  // namespace voxelpipe
