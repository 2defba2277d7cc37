#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "completion/scripts.h"

namespace voxelpipe::cli {
namespace {

std::string NamesOf(const std::vector<OptionModel>& options) {
  std::string names;
  for (const OptionModel& option : options) {
    absl::StrAppend(&names, names.empty() ? "" : " ", absl::StrJoin(option.names, " "));
  }
  return names;
}

// The statement that proposes values of this kind.
std::string Propose(const OptionModel& option) {
  switch (option.kind) {
    case ValueKind::kChoice: return absl::StrCat("_voxelpipe_words \"", absl::StrJoin(option.choices, " "), "\"");
    case ValueKind::kFile: return "_voxelpipe_paths -f";
    case ValueKind::kDirectory: return "_voxelpipe_paths -d";
    case ValueKind::kNone:
    case ValueKind::kFree: break;
  }
  return ":";
}

}  // namespace

std::string BashCompletion(const ProgramModel& program) {
  std::string commands, values, options, arguments;
  for (const CommandModel& command : program.commands) {
    absl::StrAppend(&commands, commands.empty() ? "" : " ", command.name);
    for (const OptionModel& option : command.options) {
      if (option.kind == ValueKind::kNone) continue;
      std::string patterns;
      for (const std::string& name : option.names) {
        absl::StrAppend(&patterns, patterns.empty() ? "" : "|", "'", command.name, " ", name, "'");
      }
      absl::StrAppend(&values, "    ", patterns, ") ", Propose(option), "; return ;;\n");
    }
    absl::StrAppend(&options, "      ", command.name, ") _voxelpipe_words \"", NamesOf(command.options), "\" ;;\n");
    if (!command.arguments.empty()) {
      absl::StrAppend(&arguments, "      ", command.name, ") ", Propose(command.arguments.front()), " ;;\n");
    }
  }
  return absl::StrCat(R"(# bash completion for voxelpipe, made by `voxelpipe completion bash`.
_voxelpipe_words() {
  mapfile -t COMPREPLY < <(compgen -W "$1" -- "$cur")
}
_voxelpipe_paths() {
  compopt -o filenames 2>/dev/null
  mapfile -t COMPREPLY < <(compgen "$1" -- "$cur")
}
_voxelpipe() {
  local cur="${COMP_WORDS[COMP_CWORD]}" prev="" command="" i
  COMPREPLY=()
  ((COMP_CWORD > 0)) && prev="${COMP_WORDS[COMP_CWORD - 1]}"
  # --option=value is three words for bash.
  if [[ $cur == "=" ]]; then
    cur=""
  elif [[ $prev == "=" ]] && ((COMP_CWORD > 1)); then
    prev="${COMP_WORDS[COMP_CWORD - 2]}"
  fi
  for ((i = 1; i < COMP_CWORD; ++i)); do
    case "${COMP_WORDS[i]}" in
      )",
                      absl::StrJoin(absl::StrSplit(commands, ' '), "|"), R"() command="${COMP_WORDS[i]}"; break ;;
    esac
  done
  case "$command $prev" in
)",
                      values, R"(  esac
  if [[ -z $command && $cur == -* ]]; then
    _voxelpipe_words ")",
                      NamesOf(program.options), R"("
  elif [[ -z $command ]]; then
    _voxelpipe_words ")",
                      commands, R"("
  elif [[ $cur == -* ]]; then
    case "$command" in
)",
                      options, R"(    esac
  else
    case "$command" in
)",
                      arguments, R"(    esac
  fi
}
complete -F _voxelpipe voxelpipe
)");
}

}  // namespace voxelpipe::cli
