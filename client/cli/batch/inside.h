// Keeps the outputs of a batch below its output directory, despite symbolic links there.
#pragma once

#include <string>

#include "absl/status/status.h"

namespace voxelpipe::cli {

// In: a path below `output_dir`. PERMISSION_DENIED, with the link and its target, if writing there would follow a link
// out of the directory; FAILED_PRECONDITION if something other than a file or directory is there. The output directory
// itself may be a link.
absl::Status CheckInside(const std::string& output_dir, const std::string& path);

}  // namespace voxelpipe::cli
