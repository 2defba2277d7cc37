#include "command_line/usage_error.h"

#include <vector>

#include "absl/strings/str_cat.h"
#include "base/nearest_name.h"

namespace voxelpipe {
namespace {

std::string InBrackets(const std::string& hint) {
  return hint.empty() ? "" : absl::StrCat(" (", hint, ")");
}

std::string NoCommand(const CLI::App& app, const std::string& typed) {
  std::vector<std::string> known;
  for (const CLI::App* command : app.get_subcommands([](const CLI::App*) { return true; })) {
    known.push_back(command->get_name());
  }
  return absl::StrCat("there is no command '", typed, "'", InBrackets(DidYouMean(typed, known)));
}

// "there is no option '--resolutoin' (did you mean '--resolution'?)" for each part that was not expected.
std::string NotExpected(const CLI::App& command, const std::vector<std::string>& unknown) {
  std::vector<std::string> known;
  for (const CLI::Option* option : command.get_options()) {
    for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
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

// The option of `command` that a message begins with, behind `start`; null if there is none.
const CLI::Option* OptionIn(const CLI::App& command, std::string_view message, std::string_view start,
                            std::string_view end) {
  for (const CLI::Option* option : command.get_options()) {
    const std::string beginning = absl::StrCat(std::string(start), option->get_name(), std::string(end));
    if (message.starts_with(beginning)) return option;
  }
  return nullptr;
}

// CLI11's messages about values in words that say what is wanted. Others are returned as they are.
std::string Reason(const CLI::App& command, const CLI::ParseError& error) {
  constexpr std::string_view kNotConverted = "Could not convert: ", kAndValue = " = ";
  const std::string message = error.what();
  if (dynamic_cast<const CLI::ConversionError*>(&error) != nullptr) {
    if (const CLI::Option* option = OptionIn(command, message, kNotConverted, kAndValue)) {
      const std::string value = message.substr(kNotConverted.size() + option->get_name().size() + kAndValue.size());
      return absl::StrCat(option->get_name(), ": '", value, "' is no number that it takes");
    }
  }
  if (dynamic_cast<const CLI::ArgumentMismatch*>(&error) != nullptr) {
    const CLI::Option* option = OptionIn(command, message, "", ": 1 required");
    if (option != nullptr && option->count() == 0) {
      return absl::StrCat(option->get_name(), " needs a value", option->get_type_name().empty() ? "" : ", ",
                          option->get_type_name());
    }
  }
  return message;
}

}  // namespace

std::string UsageError(const CLI::App& app, const CLI::ParseError& error) {
  const std::vector<CLI::App*> given = app.get_subcommands();
  const std::vector<std::string> unknown = app.remaining(true);
  const bool has_commands = !app.get_subcommands([](const CLI::App*) { return true; }).empty();
  const CLI::App& command = given.empty() ? app : *given.front();
  std::string text;
  if (has_commands && given.empty() && !unknown.empty() && !unknown.front().starts_with('-')) {
    text = NoCommand(app, unknown.front());
  } else if (dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr && !unknown.empty()) {
    text = NotExpected(command, unknown);
  } else {
    text = Reason(command, error);
  }
  const std::string help = given.empty() ? app.get_name() : absl::StrCat(app.get_name(), " ", command.get_name());
  return absl::StrCat(text, "; see '", help, " --help'");
}

}  // namespace voxelpipe
