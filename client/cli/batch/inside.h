// Keeps what a batch writes below its output directory, whatever links lie there.
#pragma once

#include <string>

#include "absl/status/status.h"

namespace voxelpipe::cli {

// In: a path below `output_dir`. PERMISSION_DENIED, with the link and where it leads, if writing there would go through
// a link out of the directory; FAILED_PRECONDITION if something other than a file or directory is there. The output
// directory itself may be a link.
absl::Status CheckInside(const std::string& output_dir, const std::string& path);

}  // namespace voxelpipe::cli
