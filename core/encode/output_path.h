// Paths of output files: targets of symbolic links, and names of valid length.
#pragma once

#include <cstddef>
#include <string>

#include "absl/status/statusor.h"

namespace voxelpipe {

// In: the path of a file to write. Out: the file that writing creates or replaces: symbolic links of the last component
// are followed, even if the target does not exist. Links among the directories are kept. Errors: the system's, with the
// path.
absl::StatusOr<std::string> FollowLinks(const std::string& path);

// In: a path, and the number of bytes to be appended to its file name. Out: the path, its file name cut if both
// together exceed the limit of file systems (255 bytes); the cut name ends with a checksum of the whole, so that long
// names stay distinct.
std::string FitFileName(const std::string& path, size_t appended_bytes);

}  // namespace voxelpipe
