#include "options/option_sources.h"

#include <algorithm>
#include <cstdlib>
#include <fstream>
#include <map>

#include <CLI/CLI.hpp>

namespace voxelpipe {
namespace {

// The source of an option that is not on the command line.
struct Found {
  std::string value, source;
};

std::map<std::string, std::string> ReadConfigFile(const CLI::App& app, const std::string& path) {
  std::ifstream file(path);
  file.peek();  // a directory opens and cannot be read
  if (file.bad() || !file.is_open()) throw CLI::FileError("--config: " + path + " cannot be read");
  std::map<std::string, std::string> values;
  for (const CLI::ConfigItem& item : CLI::ConfigTOML().from_config(file)) {
    if (item.name == "++" || item.name == "--") continue;  // begin and end of a section
    std::string key = item.fullname();
    const CLI::Option* option = item.parents.empty() ? app.get_option_no_throw("--" + key) : nullptr;
    if (option == nullptr || !option->get_configurable()) {
      throw CLI::ConfigError(path + ": " + key + " is not an option of the config file");
    }
    key = option->get_lnames()[0];  // an option may have a second name
    if (item.inputs.size() != 1) throw CLI::ConfigError(path + ": " + key + " needs one value, once");
    if (!values.emplace(key, item.inputs[0]).second) throw CLI::ConfigError(path + ": " + key + " is given twice");
  }
  return values;
}

void ParseAgain(CLI::App& app, std::vector<std::string> arguments, const std::map<std::string, Found>& found) {
  for (const auto& [key, at] : found) arguments.push_back("--" + key + "=" + at.value);
  std::reverse(arguments.begin(), arguments.end());
  try {
    app.parse(arguments);
  } catch (const CLI::ValidationError& error) {
    // "--key: reason"; if the value was not given as a flag, the error names its source.
    const std::string text = error.what();
    for (const auto& [key, at] : found) {
      if (text.starts_with("--" + key + ":")) throw CLI::ValidationError(at.source, text);
    }
    throw;
  } catch (const CLI::ConversionError& error) {
    const std::string text = error.what();
    for (const auto& [key, at] : found) {
      if (text.find("--" + key) != std::string::npos) throw CLI::ConversionError(at.source + ": " + text, "");
    }
    throw;
  }
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
std::string SetVariableOf(const CLI::Option& option) {
  for (const std::string& name : option.get_lnames()) {
    std::string variable = VariableOf(name);
    if (const char* value = std::getenv(variable.c_str()); value != nullptr && *value != '\0') return variable;
  }
  return "";
}

}  // namespace

std::vector<OptionValue> ParseFromAllSources(CLI::App& app, int argc, const char* const* argv) {
  app.parse(argc, argv);
  std::vector<std::string> given(argv + 1, argv + argc);
  std::map<std::string, std::string> sources;
  std::map<std::string, Found> found;
  std::string config;
  if (const CLI::Option* option = app.get_option("--config"); option->count() > 0) {
    config = option->as<std::string>();
  } else if (const char* value = std::getenv("VOXELPIPE_CONFIG")) {
    config = value;
  }
  std::map<std::string, std::string> in_file;
  if (!config.empty()) in_file = ReadConfigFile(app, config);

  std::vector<CLI::Option*> options = app.get_options([](CLI::Option* o) { return o->get_configurable(); });
  std::erase_if(options,
                [](CLI::Option* o) { return o->get_lnames()[0] == "help" || o->get_lnames()[0] == "version"; });
  for (const CLI::Option* option : options) {
    const std::string& key = option->get_lnames()[0];
    const std::string variable = SetVariableOf(*option);
    if (option->count() > 0) {
      sources[key] = "flag";
    } else if (!variable.empty()) {
      found[key] = {std::getenv(variable.c_str()), sources[key] = "environment " + variable};
    } else if (const auto it = in_file.find(key); it != in_file.end() && !it->second.empty()) {
      found[key] = {it->second, sources[key] = "file " + config};
    } else {
      sources[key] = "default";
    }
  }
  if (!found.empty()) ParseAgain(app, std::move(given), found);

  std::vector<OptionValue> values;
  for (const CLI::Option* option : options) {
    const std::string& key = option->get_lnames()[0];
    std::string value = option->count() > 0 ? option->results().back() : option->get_default_str();
    if (option->get_type_name() == "BOOLEAN") value = option->as<bool>() ? "true" : "false";
    values.push_back({key, std::move(value), sources[key]});
  }
  return values;
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
