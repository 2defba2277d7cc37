#include "completion/command_model.h"

#include <CLI/CLI.hpp>
#include <algorithm>

#include "absl/strings/str_split.h"
#include "shaders/catalog.h"

namespace voxelpipe::cli {
namespace {

std::string OneLine(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  return text;
}

std::vector<std::string> ShaderNames(ShaderStage stage) {
  std::vector<std::string> names;
  for (const ShaderInfo& shader : ListShaders()) {
    if (shader.stage == stage) names.push_back(shader.name);
  }
  return names;
}

// "a|b|c" of lower-case words, which may have dots.
std::vector<std::string> ChoicesOf(const std::string& type) {
  const bool words = type.find('|') != std::string::npos &&
                     type.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_.|") == std::string::npos;
  return words ? std::vector<std::string>(absl::StrSplit(type, '|')) : std::vector<std::string>();
}

OptionModel ModelOf(const CLI::Option& option) {
  OptionModel model;
  for (const std::string& name : option.get_snames()) model.names.push_back("-" + name);
  for (const std::string& name : option.get_lnames()) model.names.push_back("--" + name);
  const bool argument = option.get_positional();
  if (argument) model.names = {option.get_name(true)};
  model.required = option.get_required();
  model.repeatable = option.get_expected_max() > 1;
  model.group = option.get_group();
  model.help = OneLine(option.get_description());
  if (option.get_expected_max() == 0) return model;
  // Checks with a description of their own are appended to the type.
  const std::string type = option.get_type_name();
  model.type = type.substr(0, type.find(":{"));
  model.choices = model.names.back() == "--shader"          ? ShaderNames(ShaderStage::kFragment)
                  : model.names.back() == "--vertex-shader" ? ShaderNames(ShaderStage::kVertex)
                                                            : ChoicesOf(model.type);
  model.kind = !model.choices.empty()                                                           ? ValueKind::kChoice
               : model.type == "FILE" || model.type == "OUT" || model.type == "PNG" || argument ? ValueKind::kFile
               : model.type == "D"                                                              ? ValueKind::kDirectory
                                                                                                : ValueKind::kFree;
  return model;
}

void AddOptions(const CLI::App& app, std::vector<OptionModel>& options, std::vector<OptionModel>* arguments) {
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_group().empty()) continue;  // hidden
    OptionModel model = ModelOf(*option);
    (option->get_positional() && arguments != nullptr ? *arguments : options).push_back(std::move(model));
  }
}

}  // namespace

ProgramModel ModelOf(const CLI::App& app) {
  ProgramModel program{app.get_name(), OneLine(app.get_description()), app.get_footer(), {}, {}};
  AddOptions(app, program.options, nullptr);
  for (const CLI::App* sub : app.get_subcommands([](const CLI::App*) { return true; })) {
    CommandModel command{sub->get_name(), OneLine(sub->get_description()), sub->get_footer(), {}, {}};
    AddOptions(*sub, command.options, &command.arguments);
    program.commands.push_back(std::move(command));
  }
  return program;
}

std::string FirstClause(const std::string& help) {
  constexpr size_t kMinBytes = 8, kMaxBytes = 72;  // a shorter clause says nothing: "tight (default): ..."
  size_t end = help.size();
  for (const char* mark : {". ", "; ", " (", ": "}) end = std::min(end, help.find(mark, kMinBytes));
  if (end <= kMaxBytes) return help.substr(0, end);
  return help.substr(0, help.rfind(' ', kMaxBytes - 3)) + "...";
}

}  // namespace voxelpipe::cli
