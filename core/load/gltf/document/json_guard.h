// Checks on JSON text that must be done before any parser sees it.
#pragma once

#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "base/job_context.h"
#include "base/warning.h"
#include "mesh/scene/load_limits.h"

namespace voxelpipe {

// In: untrusted JSON text. Refuses text above max_json_bytes, and nesting above max_json_depth (parsers recurse). It
// does not prove that the text is JSON. Errors: RESOURCE_EXHAUSTED naming the limit; the job's.
absl::Status GuardJson(const JobContext& job, std::string_view json, const LoadLimits& limits);

// `json` without a byte order mark, which glTF forbids and some editors write; then a warning.
std::string_view WithoutByteOrderMark(std::string_view json, WarningList& warnings);

// Untrusted text for an error message: one line, printable, at most about 80 characters.
std::string Quoted(std::string_view text);

}  // namespace voxelpipe
