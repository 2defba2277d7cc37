// Reads files from the local disk; for the client side only.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "absl/status/statusor.h"
#include "base/memory_budget.h"
#include "load/file_bytes.h"

namespace voxelpipe {

// The whole of a regular file of at most `max_bytes`. Errors: NOT_FOUND, INVALID_ARGUMENT (a directory, a device, a
// pipe), RESOURCE_EXHAUSTED past the limit, otherwise the system's with its reason. The caller adds the path.
absl::StatusOr<FileBytes> ReadLocalFile(const std::filesystem::path& path, uint64_t max_bytes);

// The same for a file that a mesh file names, charged before it is read. RESOURCE_EXHAUSTED also for the memory of the
// charge.
absl::StatusOr<FileBytes> ReadSibling(const std::filesystem::path& path, uint64_t max_bytes, MemoryCharge& charge);

// A file that a mesh file names.
struct SiblingFile {
  std::filesystem::path path;  // canonical: percent-encoding decoded, symbolic links resolved
  std::string outside;  // empty inside the mesh file's directory; otherwise how it leaves it: the link and its target
};

// In: the URI reference and the directory of its glTF file. Errors: INVALID_ARGUMENT naming the URI for a scheme, an
// absolute path, a backslash or broken percent-encoding. The file need not exist.
absl::StatusOr<SiblingFile> ResolveSibling(const std::filesystem::path& directory, const std::string& uri);

// The same for a name that is no URI, as OBJ files and their material libraries have them: not percent-encoded, "\\"
// between folders counts as "/". Errors: INVALID_ARGUMENT.
absl::StatusOr<SiblingFile> ResolveSiblingName(const std::filesystem::path& directory, const std::string& name);

// "URI 'x'", shortened if it is long, for errors.
std::string UriName(const std::string& uri);

}  // namespace voxelpipe
