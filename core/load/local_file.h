// Reading files from this machine's disk, for the client side only.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "absl/status/statusor.h"
#include "load/file_bytes.h"

namespace voxelpipe {

// The whole of a regular file of at most `max_bytes`. Errors: NOT_FOUND, INVALID_ARGUMENT (a directory, a device, a
// pipe), RESOURCE_EXHAUSTED past the limit, otherwise the system's with its reason. None names the path: the caller
// does.
absl::StatusOr<FileBytes> ReadLocalFile(const std::filesystem::path& path, uint64_t max_bytes);

// What a relative URI reference of a glTF file names.
struct SiblingFile {
  std::filesystem::path path;  // canonical: percent-encoding decoded, symbolic links resolved
  std::string
      outside;  // empty inside of the glTF file's directory; else how it leaves it: the link, and where it leads
};

// In: the URI reference and the directory of its glTF file. Errors: INVALID_ARGUMENT naming the URI for a scheme, an
// absolute path, a backslash or broken percent-encoding. The file need not be there.
absl::StatusOr<SiblingFile> ResolveSibling(const std::filesystem::path& directory, const std::string& uri);

// "URI 'x'", cut where it is long, for errors.
std::string UriName(const std::string& uri);

}  // namespace voxelpipe
