#include "command_line/usage_error.h"

#include <optional>
#include <string_view>
#include <vector>

#include "absl/strings/str_cat.h"
#include "base/nearest_name.h"

namespace voxelpipe {
namespace {

std::string InBrackets(const std::string& hint) {
  return hint.empty() ? "" : absl::StrCat(" (", hint, ")");
}

std::string NoCommand(const Program& program, const std::string& typed) {
  std::vector<std::string> known;
  for (const Command& command : program.commands()) known.push_back(command.name());
  return absl::StrCat("there is no command '", typed, "'", InBrackets(DidYouMean(typed, known)));
}

// "there is no option '--resolutoin' (did you mean '--resolution'?)" for each part that was not expected.
std::string NotExpected(const Command& command, const std::vector<std::string>& unknown) {
  std::vector<std::string> known;
  for (const Option& option : command.options()) {
    for (const std::string& name : option.long_names()) known.push_back("--" + name);
  }
  std::string text;
  for (const std::string& typed : unknown) {
    const std::string name = typed.substr(0, typed.find('='));
    const bool option = typed.starts_with('-');
    absl::StrAppend(&text, text.empty() ? "" : ", ", option ? "there is no option '" : "one argument too many: '",
                    option ? name : typed, "'", option ? InBrackets(DidYouMean(name, known)) : "");
  }
  return text;
}

// The option of `command` that a message begins with, behind `start`.
std::optional<Option> OptionIn(const Command& command, std::string_view message, std::string_view start,
                               std::string_view end) {
  for (const Option& option : command.options()) {
    const std::string beginning = absl::StrCat(std::string(start), option.name(), std::string(end));
    if (message.starts_with(beginning)) return option;
  }
  return std::nullopt;
}

// CLI11's messages about values in words that say what is wanted. Others are returned as they are.
std::string Reason(const Command& command, const ParseStop& stop) {
  constexpr std::string_view kNotConverted = "Could not convert: ", kAndValue = " = ";
  if (stop.kind == ParseStop::Kind::kConversion) {
    if (const auto option = OptionIn(command, stop.text, kNotConverted, kAndValue)) {
      const std::string value = stop.text.substr(kNotConverted.size() + option->name().size() + kAndValue.size());
      return absl::StrCat(option->name(), ": '", value, "' is no number that it takes");
    }
  }
  if (stop.kind == ParseStop::Kind::kCount) {
    const std::optional<Option> option = OptionIn(command, stop.text, "", ": 1 required");
    if (option && option->count() == 0) {
      return absl::StrCat(option->name(), " needs a value", option->type().empty() ? "" : ", ", option->type());
    }
  }
  return stop.text;
}

}  // namespace

std::string UsageError(const Program& program, const ParseStop& stop) {
  const std::optional<Command> given = program.given();
  const std::vector<std::string> unknown = program.unexpected();
  const Command& command = given ? *given : program;
  std::string text;
  if (!program.commands().empty() && !given && !unknown.empty() && !unknown.front().starts_with('-')) {
    text = NoCommand(program, unknown.front());
  } else if (stop.kind == ParseStop::Kind::kUnexpected && !unknown.empty()) {
    text = NotExpected(command, unknown);
  } else {
    text = Reason(command, stop);
  }
  const std::string help = given ? absl::StrCat(program.name(), " ", command.name()) : program.name();
  return absl::StrCat(text, "; see '", help, " --help'");
}

}  // namespace voxelpipe
