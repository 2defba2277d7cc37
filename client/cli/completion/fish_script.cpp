#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "completion/scripts.h"

namespace voxelpipe::cli {
namespace {

std::string Quoted(const std::string& text) {
  return "'" + absl::StrReplaceAll(text, {{"\\", "\\\\"}, {"'", "\\'"}}) + "'";
}

std::string Value(const OptionModel& option) {
  switch (option.kind) {
    case ValueKind::kNone: return "";
    case ValueKind::kChoice: return absl::StrCat(" -x -a ", Quoted(absl::StrJoin(option.choices, " ")));
    case ValueKind::kFile: return " -r -F";
    case ValueKind::kDirectory: return " -x -a '(__fish_complete_directories)'";
    case ValueKind::kFree: break;
  }
  return " -x";
}

std::string Names(const OptionModel& option) {
  std::string names;
  for (const std::string& name : option.names) {
    absl::StrAppend(&names, name.starts_with("--") ? " -l " + name.substr(2) : " -s " + name.substr(1));
  }
  return names;
}

}  // namespace

std::string FishCompletion(const ProgramModel& program) {
  std::string script =
      "# fish completion for voxelpipe, made by `voxelpipe completion fish`.\ncomplete -c voxelpipe -f\n";
  for (const OptionModel& option : program.options) {
    absl::StrAppend(&script, "complete -c voxelpipe -n __fish_use_subcommand", Names(option), " -d ",
                    Quoted(FirstClause(option.help)), "\n");
  }
  for (const CommandModel& command : program.commands) {
    absl::StrAppend(&script, "complete -c voxelpipe -n __fish_use_subcommand -a ", command.name, " -d ",
                    Quoted(FirstClause(command.help)), "\n");
    const std::string prefix =
        absl::StrCat("complete -c voxelpipe -n '__fish_seen_subcommand_from ", command.name, "'");
    for (const OptionModel& option : command.options) {
      absl::StrAppend(&script, prefix, Names(option), Value(option), " -d ", Quoted(FirstClause(option.help)), "\n");
    }
    if (command.arguments.empty()) continue;
    const OptionModel& argument = command.arguments.front();
    absl::StrAppend(&script, prefix,
                    argument.kind == ValueKind::kChoice
                        ? absl::StrCat(" -a ", Quoted(absl::StrJoin(argument.choices, " ")))
                        : " -F",
                    "\n");
  }
  return script;
}

}  // namespace voxelpipe::cli
