// NumPy's archives of named arrays.
#pragma once

#include <memory>
#include <string>

#include "encode/result_file.h"

namespace voxelpipe {

// See OpenResultFile for what it holds. The file is created by Begin.
std::unique_ptr<ResultFile> MakeNpzFile(const std::string& path, const JobContext* job);

}  // namespace voxelpipe
