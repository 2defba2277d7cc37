// "-" on the command line: standard input and standard output.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "load/file_bytes.h"

namespace voxelpipe::cli {

inline bool IsStandardStream(const std::string& path) {
  return path == "-";
}

// The name of an input in messages: "standard input" for "-", otherwise the path.
std::string InputName(const std::string& path);

// INVALID_ARGUMENT, with what to type, if "-" is among the inputs more than once, or standard input (standard output)
// is a terminal.
absl::Status CheckInputStream(const std::vector<std::string>& inputs);
absl::Status CheckStandardOutput();

// All of standard input, at most `max_bytes`. `job` is polled while nothing arrives. Errors: RESOURCE_EXHAUSTED past
// the limit; those of the job; otherwise the system's with its reason. May throw bad_alloc.
absl::StatusOr<FileBytes> ReadStandardInput(uint64_t max_bytes, const JobContext& job);

}  // namespace voxelpipe::cli
