// Checks on JSON text that must be done before any parser sees it.
#pragma once

#include <string>
#include <string_view>

#include "absl/status/status.h"
#include "load/limits.h"

namespace voxelpipe {

// In: JSON text of a stranger. Refuses a byte order mark, text above max_json_bytes, and nesting above max_json_depth
// (parsers recurse). It does not prove that the text is JSON.
// Errors: INVALID_ARGUMENT naming the byte, RESOURCE_EXHAUSTED naming the limit.
absl::Status GuardJson(std::string_view json, const LoadLimits& limits);

// A stranger's text for an error message: one line, printable, at most about 80 characters.
std::string Quoted(std::string_view text);

}  // namespace voxelpipe
