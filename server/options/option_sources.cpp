#include "options/option_sources.h"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <map>
#include <utility>

#include "absl/status/statusor.h"

namespace voxelpipe {
namespace {

// The source of an option that is not on the command line.
struct Found {
  std::string value, source;
};

// Out: the values of the file by the first names of their options; or the error in it.
absl::StatusOr<std::map<std::string, std::string>> ReadConfigFile(const Program& program, const std::string& path) {
  const auto error = [](const std::string& text) { return absl::InvalidArgumentError(text); };
  std::ifstream file(path);
  file.peek();  // a directory opens and cannot be read
  if (file.bad() || !file.is_open()) return error("--config: " + path + " cannot be read");
  std::map<std::string, std::string> values;
  for (const ConfigItem& item : ReadConfigItems(file)) {
    const std::optional<Option> option = item.in_section ? std::nullopt : program.FindOption("--" + item.key);
    if (!option || !option->configurable()) {
      return error(path + ": " + item.key + " is not an option of the config file");
    }
    const std::string& key = option->long_names()[0];  // an option may have a second name
    if (item.values.size() != 1) return error(path + ": " + key + " needs one value, once");
    if (!values.emplace(key, item.values[0]).second) return error(path + ": " + key + " is given twice");
  }
  return values;
}

std::optional<ParseStop> ParseAgain(Program& program, std::vector<std::string> arguments,
                                    const std::map<std::string, Found>& found) {
  for (const auto& [key, at] : found) arguments.push_back("--" + key + "=" + at.value);
  std::optional<ParseStop> stop = program.Parse(std::move(arguments));
  if (!stop) return std::nullopt;
  // If the value was not given as a flag, the error names its source.
  for (const auto& [key, at] : found) {
    if (stop->kind == ParseStop::Kind::kCheck && stop->text.starts_with("--" + key + ":")) {
      stop->text = at.source + ": " + stop->text;
      break;
    }
    if (stop->kind == ParseStop::Kind::kConversion && stop->text.find("--" + key) != std::string::npos) {
      stop->text = "The value " + at.source + ": " + stop->text + " is not an allowed value for ";
      break;
    }
  }
  return stop;
}

bool IsBare(const std::string& value) {
  return value == "true" || value == "false" ||
         (!value.empty() && value.find_first_not_of("0123456789") == std::string::npos);
}

}  // namespace

std::string VariableOf(const std::string& flag) {
  std::string variable = "VOXELPIPE_";
  for (const char c : flag.substr(flag.find_first_not_of('-'))) {
    variable += c == '-' ? '_' : char(std::toupper(static_cast<unsigned char>(c)));
  }
  return variable;
}

namespace {

// The variable that sets the option, under any of its names; empty if none does.
std::string SetVariableOf(const Option& option) {
  for (const std::string& name : option.long_names()) {
    std::string variable = VariableOf(name);
    if (const char* value = std::getenv(variable.c_str()); value != nullptr && *value != '\0') return variable;
  }
  return "";
}

}  // namespace

std::optional<ParseStop> ParseFromAllSources(Program& program, int argc, const char* const* argv,
                                             std::vector<OptionValue>& values) {
  std::vector<std::string> given(argv + 1, argv + argc);
  if (std::optional<ParseStop> stop = program.Parse(given)) return stop;
  std::map<std::string, std::string> sources;
  std::map<std::string, Found> found;
  std::string config;
  if (const std::optional<Option> option = program.FindOption("--config"); option->count() > 0) {
    config = option->value();
  } else if (const char* value = std::getenv("VOXELPIPE_CONFIG")) {
    config = value;
  }
  std::map<std::string, std::string> in_file;
  if (!config.empty()) {
    absl::StatusOr<std::map<std::string, std::string>> read = ReadConfigFile(program, config);
    if (!read.ok()) return ParseStop{ParseStop::Kind::kOther, std::string(read.status().message())};
    in_file = *std::move(read);
  }

  std::vector<Option> options = program.options();
  std::erase_if(options, [](const Option& o) {
    return !o.configurable() || o.long_names()[0] == "help" || o.long_names()[0] == "version";
  });
  for (const Option& option : options) {
    const std::string& key = option.long_names()[0];
    const std::string variable = SetVariableOf(option);
    if (option.count() > 0) {
      sources[key] = "flag";
    } else if (!variable.empty()) {
      found[key] = {std::getenv(variable.c_str()), sources[key] = "environment " + variable};
    } else if (const auto it = in_file.find(key); it != in_file.end() && !it->second.empty()) {
      found[key] = {it->second, sources[key] = "file " + config};
    } else {
      sources[key] = "default";
    }
  }
  if (!found.empty()) {
    if (std::optional<ParseStop> stop = ParseAgain(program, std::move(given), found)) return stop;
  }

  for (const Option& option : options) {
    const std::string& key = option.long_names()[0];
    std::string value = option.count() > 0 ? option.value() : option.default_text();
    if (option.is_bool()) value = option.bool_value() ? "true" : "false";
    values.push_back({key, std::move(value), sources[key]});
  }
  return std::nullopt;
}

std::string ToConfigText(const std::vector<OptionValue>& values) {
  std::string text;
  for (const OptionValue& v : values) {
    const std::string value = IsBare(v.value) ? v.value : "\"" + v.value + "\"";
    text += v.key + " = " + value + "  # " + v.source + "\n";
  }
  return text;
}

}  // namespace voxelpipe
