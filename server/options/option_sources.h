// Where the value of an option comes from: a flag is stronger than its environment variable, that than the config file,
// that than the default. The one place that knows this order.
#pragma once

#include <string>
#include <vector>

namespace CLI {
class App;
}

namespace voxelpipe {

// One option as it came out.
struct OptionValue {
  std::string key;     // in the config file: the flag without its dashes
  std::string value;   // as it would be written
  std::string source;  // "flag", "environment VOXELPIPE_...", "file FILE" or "default"
};

// "--max-queue" -> "VOXELPIPE_MAX_QUEUE".
std::string VariableOf(const std::string& flag);

// Parses the command line into the variables that `app` is bound to, taking options that it does not give from the
// environment and then from the config file that its option --config (flag or variable) names. Only configurable
// options have a variable and a key. An empty variable or key counts as not given.
// Out: all configurable options in the order of --help. Throws CLI::ParseError (help and version included), naming the
// source; a key that the file has and `app` has not, or a file that cannot be read, is one.
std::vector<OptionValue> ParseFromAllSources(CLI::App& app, int argc, const char* const* argv);

// Lines of a config file that sets the same values: `key = value  # source`.
std::string ToConfigText(const std::vector<OptionValue>& values);

}  // namespace voxelpipe
