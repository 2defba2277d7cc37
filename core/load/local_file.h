// Reading files from this machine's disk, for the client side only.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "absl/status/statusor.h"
#include "load/file_bytes.h"

namespace voxelpipe {

// The whole of a regular file of at most `max_bytes`. Errors: NOT_FOUND, INVALID_ARGUMENT (a directory, a device, a pipe),
// RESOURCE_EXHAUSTED past the limit; all name the path.
absl::StatusOr<FileBytes> ReadLocalFile(const std::filesystem::path& path, uint64_t max_bytes);

// In: a relative URI reference of a glTF file and the directory of that file. Out: the canonical path that it names,
// percent-encoding decoded and symbolic links resolved. Errors: INVALID_ARGUMENT naming the URI for a scheme, an absolute
// path, a backslash, broken percent-encoding, or a path that leaves the directory; NOT_FOUND if there is no such file.
absl::StatusOr<std::filesystem::path> ResolveSibling(const std::filesystem::path& directory, const std::string& uri);

}  // namespace voxelpipe
