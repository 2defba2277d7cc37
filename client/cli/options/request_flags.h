// The options of a request, the same for every command that voxelizes.
#pragma once

#include <string>

#include "command_line/command.h"
#include "request_text/request_options.h"

namespace voxelpipe::cli {

inline constexpr char kExecutionGroup[] = "Execution";

// Breaks a description so that it fits beside the option names on a terminal.
std::string Wrapped(const std::string& text);

// Adds them to `command`; `request` must outlive it.
void AddRequestFlags(Command& command, RequestOptions& request);

}  // namespace voxelpipe::cli
