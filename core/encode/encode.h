// Writes results to files.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "job/result.h"

namespace voxelpipe {

// The extension decides the format (format_registry.h). In: a path. Out: the longest extension of a format that ends
// its name, as ".nii.gz", otherwise what follows the last dot; lower case, with the dot; empty if there is none.
std::string FileExtension(std::string_view path);
bool IsKnownExtension(std::string_view extension);

// The files of a result: one, or OUT.<index>.ext for each of several targets where the format takes one a file.
std::vector<std::string> OutputPaths(const std::string& path, size_t target_count);
// Those, and the description of a .raw output: every file that WriteResult creates for `path`.
std::vector<std::string> WrittenPaths(const std::string& path, size_t target_count);

// Writes `result` to `path` in the format of its extension, each file under a temporary name and then renamed. `job`,
// if given, is polled between pieces; a cancelled job leaves no file. Errors: INVALID_ARGUMENT for an unknown
// extension; CANCELLED, DEADLINE_EXCEEDED; RESOURCE_EXHAUSTED out of memory; otherwise the system's error with the
// path.
absl::Status WriteResult(const VoxelizeResult& result, const std::string& path, const JobContext* job = nullptr);

}  // namespace voxelpipe
