// A result as a file in a folder of its own.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "absl/status/status.h"
#include "base/warning.h"
#include "encode/format_registry.h"
#include "jobs/result_export.h"
#include "web/download/temporary_folder.h"

namespace voxelpipe {

// The file that a job makes for someone who waits for the end of its call. Shared by both: the folder lives until both
// are done with it.
struct ExportedFile {
  const OutputFormat& format;
  const uint64_t max_bytes;  // of all files at the same time
  const TemporaryFolder folder;
  // Once the call has ended with OK:
  std::string path;      // of the complete file
  WarningList warnings;  // of what the format does not hold
};

// Writes a result of any kind that `file.format` holds. Several files of a result (.raw with its description, a file a
// target, a directory) become one .zip.
MakeExport ExportTo(std::shared_ptr<ExportedFile> file);

// What a caller may know of an error: the system's error in a file of this machine goes to the log, and comes back
// without its path.
absl::Status WithoutPaths(absl::Status status);

// RESOURCE_EXHAUSTED: the file exceeds what is left of `max_bytes`.
absl::Status FileTooLarge(uint64_t max_bytes);

}  // namespace voxelpipe
