// NumPy's archives of named arrays.
#pragma once

#include <memory>
#include <string>

#include "encode/result_file.h"

namespace voxelpipe {

// See OpenResultFile for the contents. Begin creates the file; an empty path is standard output.
std::unique_ptr<ResultFile> MakeNpzFile(const std::string& path, const JobContext* job);

}  // namespace voxelpipe
