// The source of the value of an option: a flag takes precedence over its environment variable, that over the config
// file, that over the default. Only this code has this order.
#pragma once

#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace voxelpipe {

// The resulting value of one option.
struct OptionValue {
  std::string key;     // in the config file: the flag without its dashes
  std::string value;   // in the form of the config file
  std::string source;  // "flag", "environment VOXELPIPE_...", "file FILE" or "default"
};

// "--max-queue" -> "VOXELPIPE_MAX_QUEUE".
std::string VariableOf(const std::string& flag);

// Parses the command line into the variables that `app` is bound to; missing options come from the environment and then
// from the config file that its option --config (flag or variable) names. Only configurable options have a variable and
// a key. An empty variable or key counts as not given. Out: all configurable options in the order of --help. Throws
// CLI::ParseError (help and version included), naming the source; a key that `app` does not have, or a file that cannot
// be read, is an error.
std::vector<OptionValue> ParseFromAllSources(CLI::App& app, int argc, const char* const* argv);

// Lines of a config file that sets the same values: `key = value  # source`.
std::string ToConfigText(const std::vector<OptionValue>& values);

}  // namespace voxelpipe
