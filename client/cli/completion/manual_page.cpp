// Source: man(7), the macros of groff's man package.
#include <algorithm>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "completion/scripts.h"

namespace voxelpipe::cli {
namespace {

// Text as roff reads it: dashes that stay dashes, and no line that begins with a control character.
std::string Roff(const std::string& text) {
  std::string escaped = absl::StrReplaceAll(text, {{"\\", "\\e"}, {"-", "\\-"}});
  if (!escaped.empty() && (escaped[0] == '.' || escaped[0] == '\'')) escaped.insert(0, "\\&");
  return escaped;
}

void AddOption(const OptionModel& option, std::string& page) {
  absl::StrAppend(&page, ".TP\n");
  std::string names;
  for (const std::string& name : option.names) {
    absl::StrAppend(&names, names.empty() ? "" : ", ", "\\fB", Roff(name), "\\fR");
  }
  absl::StrAppend(&page, names, option.type.empty() ? "" : " \\fI" + Roff(option.type) + "\\fR", "\n",
                  Roff(option.help), option.required ? " (required)" : "", "\n");
}

// Options by group, in the order of the help.
void AddOptions(const std::vector<OptionModel>& options, std::string& page) {
  std::vector<std::string> groups;
  for (const OptionModel& option : options) {
    if (std::find(groups.begin(), groups.end(), option.group) == groups.end()) groups.push_back(option.group);
  }
  for (const std::string& group : groups) {
    if (groups.size() > 1) absl::StrAppend(&page, ".PP\n\\fI", Roff(group), ":\\fR\n");
    for (const OptionModel& option : options) {
      if (option.group == group) AddOption(option, page);
    }
  }
}

std::string Synopsis(const ProgramModel& program, const CommandModel& command) {
  std::string line = absl::StrCat("\\fB", program.name, " ", Roff(command.name), "\\fR");
  for (const OptionModel& argument : command.arguments) {
    absl::StrAppend(&line, " \\fI", Roff(argument.names[0]), "\\fR", argument.repeatable ? " ..." : "");
  }
  for (const OptionModel& option : command.options) {
    if (option.required)
      absl::StrAppend(&line, " \\fB", Roff(option.names.back()), "\\fR \\fI", Roff(option.type), "\\fR");
  }
  return line + " [\\fIoption\\fR ...]";
}

}  // namespace

std::string ManualPage(const ProgramModel& program, const std::string& version) {
  // The page has no date, so that builds are reproducible.
  std::string page = absl::StrCat(".\\\" Made by `voxelpipe manual` of the program's own help.\n.TH ",
                                  absl::AsciiStrToUpper(program.name), " 1 \"\" \"VoxelPipe ", Roff(version),
                                  "\" \"User Commands\"\n.SH NAME\n", program.name,
                                  " \\- voxelize triangle meshes\n.SH SYNOPSIS\n.nf\n");
  for (const CommandModel& command : program.commands) absl::StrAppend(&page, Synopsis(program, command), "\n");
  absl::StrAppend(&page, ".fi\n.SH DESCRIPTION\n", Roff(program.help), "\n.SH OPTIONS\n");
  AddOptions(program.options, page);
  absl::StrAppend(&page, ".SH COMMANDS\n");
  for (const CommandModel& command : program.commands) {
    absl::StrAppend(&page, ".SS ", Roff(command.name), "\n", Roff(command.help), ".\n");
    for (const OptionModel& argument : command.arguments) AddOption(argument, page);
    AddOptions(command.options, page);
    if (!command.footer.empty()) absl::StrAppend(&page, ".PP\n", Roff(command.footer), "\n");
  }
  absl::StrAppend(&page, ".SH EXIT STATUS\n", Roff(program.footer), "\n");
  absl::StrAppend(&page, ".SH ENVIRONMENT\n.TP\n\\fBVOXELPIPE_TOKEN\\fR\n",
                  Roff("The token that is sent to servers without --token-file."), "\n");
  return page;
}

}  // namespace voxelpipe::cli
