// Writes the result of a job as a file.
#pragma once

#include <memory>
#include <string>

#include "absl/status/statusor.h"
#include "encode/format_registry.h"
#include "export/exported_file.h"
#include "jobs/result_export.h"

namespace voxelpipe {

// The format of this name; INVALID_ARGUMENT naming those that there are, or why this build has not the one.
absl::StatusOr<const OutputFormat*> ExportFormatNamed(const std::string& name);

// Writes a result of any kind that `file.format` holds. Several files of a result (.raw with its description, a file a
// target, a directory) become one .zip.
MakeExport ExportTo(std::shared_ptr<ExportedFile> file);

}  // namespace voxelpipe
