// Writes the result of a job as a file.
#pragma once

#include <memory>

#include "export/exported_file.h"
#include "jobs/result_export.h"

namespace voxelpipe {

// Writes a result of any kind that `file.format` holds. Several files of a result (.raw with its description, a file a
// target, a directory) become one .zip.
MakeExport ExportTo(std::shared_ptr<ExportedFile> file);

}  // namespace voxelpipe
