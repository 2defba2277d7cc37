// The paths of files that are written: where symbolic links lead, and names that a file system takes.
#pragma once

#include <cstddef>
#include <string>

#include "absl/status/statusor.h"

namespace voxelpipe {

// In: the path of a file to write. Out: the file that this creates or replaces: symbolic links of the last part are
// followed, also where the last one leads to nothing yet. Links among the directories stay as they are. Errors: the
// system's, with the path.
absl::StatusOr<std::string> FollowLinks(const std::string& path);

// In: a path, and the bytes that are to be appended to its file name. Out: the path, its file name cut if both together
// are more than file systems take (255 bytes); then the name ends with a checksum of itself, so that two long names
// stay two.
std::string FitFileName(const std::string& path, size_t appended_bytes);

}  // namespace voxelpipe
