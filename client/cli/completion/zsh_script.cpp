#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "completion/scripts.h"

namespace voxelpipe::cli {
namespace {

// For a description inside a specification of _arguments, which stands in single quotes.
std::string Escaped(const std::string& text) {
  return absl::StrReplaceAll(FirstClause(text),
                             {{"\\", "\\\\"}, {"'", "'\\''"}, {"[", "\\["}, {"]", "\\]"}, {":", "\\:"}});
}

// The part of a specification that says what the value is.
std::string Value(const OptionModel& option) {
  switch (option.kind) {
    case ValueKind::kNone: return "";
    case ValueKind::kChoice: return absl::StrCat(":value:(", absl::StrJoin(option.choices, " "), ")");
    case ValueKind::kFile: return ":file:_files";
    case ValueKind::kDirectory: return ":directory:_files -/";
    case ValueKind::kFree: break;
  }
  return ":value: ";
}

std::string Specifications(const CommandModel& command) {
  std::string all;
  for (const OptionModel& option : command.options) {
    for (const std::string& name : option.names) {
      const bool is_long = name.starts_with("--");
      const std::string others = option.repeatable         ? "*"
                                 : option.names.size() > 1 ? absl::StrCat("(", absl::StrJoin(option.names, " "), ")")
                                                           : "";
      // Both `--name value` and `--name=value`; `-n value` and `-nvalue`.
      const char* glue = option.kind == ValueKind::kNone ? "" : is_long ? "=" : "+";
      absl::StrAppend(&all, " \\\n        '", others, name, glue, "[", Escaped(option.help), "]", Value(option), "'");
    }
  }
  for (const OptionModel& argument : command.arguments) {
    absl::StrAppend(&all, " \\\n        '", argument.repeatable ? "*" : "", Value(argument), "'");
  }
  return all;
}

}  // namespace

std::string ZshCompletion(const ProgramModel& program) {
  std::string commands, cases;
  for (const CommandModel& command : program.commands) {
    absl::StrAppend(&commands, "\n    '", command.name, ":", Escaped(command.help), "'");
    absl::StrAppend(&cases, "    ", command.name, ")\n      _arguments", Specifications(command), "\n      ;;\n");
  }
  std::string options;
  for (const OptionModel& option : program.options) {
    for (const std::string& name : option.names) {
      absl::StrAppend(&options, " \\\n    '(- *)", name, "[", Escaped(option.help), "]'");
    }
  }
  return absl::StrCat(R"(#compdef voxelpipe
# zsh completion for voxelpipe, made by `voxelpipe completion zsh`.
_voxelpipe() {
  local context state state_descr line ret=1
  typeset -A opt_args
  local -a commands=()",
                      commands, R"(
  )
  _arguments -C)",
                      options, R"( \
    '1:command:->command' '*::argument:->argument' && ret=0
  if [[ $state == command ]]; then
    _describe command commands && ret=0
  elif [[ $state == argument ]]; then
    case $words[1] in
)",
                      cases, R"(    esac && ret=0
  fi
  return ret
}
if [[ $funcstack[1] == _voxelpipe ]]; then
  _voxelpipe "$@"
else
  compdef _voxelpipe voxelpipe
fi
)");
}

}  // namespace voxelpipe::cli
