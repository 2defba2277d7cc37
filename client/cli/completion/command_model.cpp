#include "completion/command_model.h"

#include <algorithm>

#include "absl/strings/str_split.h"
#include "command_line/command.h"
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

OptionModel ModelOf(const Option& option) {
  OptionModel model;
  model.names = option.names();
  const bool argument = option.positional();
  model.required = option.required();
  model.repeatable = option.max_values() > 1;
  model.group = option.group();
  model.help = OneLine(option.description());
  if (option.max_values() == 0) return model;
  // Checks with a description of their own are appended to the type.
  const std::string type = option.type();
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

void AddOptions(const Command& command, std::vector<OptionModel>& options, std::vector<OptionModel>* arguments) {
  for (const Option& option : command.options()) {
    if (option.group().empty()) continue;  // hidden
    OptionModel model = ModelOf(option);
    (option.positional() && arguments != nullptr ? *arguments : options).push_back(std::move(model));
  }
}

}  // namespace

ProgramModel ModelOf(const Command& program) {
  ProgramModel model{program.name(), OneLine(program.description()), program.footer(), {}, {}};
  AddOptions(program, model.options, nullptr);
  for (const Command& command : program.commands()) {
    CommandModel of_command{command.name(), OneLine(command.description()), command.footer(), {}, {}};
    AddOptions(command, of_command.options, &of_command.arguments);
    model.commands.push_back(std::move(of_command));
  }
  return model;
}

std::string FirstClause(const std::string& help) {
  constexpr size_t kMinBytes = 8, kMaxBytes = 72;  // a shorter clause says nothing: "tight (default): ..."
  size_t end = help.size();
  for (const char* mark : {". ", "; ", " (", ": "}) end = std::min(end, help.find(mark, kMinBytes));
  if (end <= kMaxBytes) return help.substr(0, end);
  return help.substr(0, help.rfind(' ', kMaxBytes - 3)) + "...";
}

}  // namespace voxelpipe::cli
