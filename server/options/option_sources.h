// The source of the value of an option: a flag takes precedence over its environment variable, that over the config
// file, that over the default. Only this code has this order.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "command_line/command.h"

namespace voxelpipe {

// The resulting value of one option.
struct OptionValue {
  std::string key;     // in the config file: the flag without its dashes
  std::string value;   // in the form of the config file
  std::string source;  // "flag", "environment VOXELPIPE_...", "file FILE" or "default"
};

// "--max-queue" -> "VOXELPIPE_MAX_QUEUE".
std::string VariableOf(const std::string& flag);

// Parses the command line into the variables of `program`; missing options come from the environment and then from the
// config file that its option --config (flag or variable) names. Only configurable options have a variable and a key.
// An empty variable or key counts as not given. Out: nothing, and in `values` all configurable options in the order of
// --help; otherwise why it stopped (help and version included), naming the source. A key that `program` does not have,
// or a file that cannot be read, is an error.
std::optional<ParseStop> ParseFromAllSources(Program& program, int argc, const char* const* argv,
                                             std::vector<OptionValue>& values);

// Lines of a config file that sets the same values: `key = value  # source`.
std::string ToConfigText(const std::vector<OptionValue>& values);

}  // namespace voxelpipe
