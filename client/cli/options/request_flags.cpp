#include "options/request_flags.h"

#include <type_traits>
#include <variant>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_replace.h"
#include "absl/strings/str_split.h"

namespace voxelpipe::cli {

// Breaks a description so that it fits beside the option names on a terminal.
std::string Wrapped(const std::string& text) {
  constexpr size_t kColumns = 78;
  std::string wrapped;
  size_t column = 0;
  for (const std::string& word : std::vector<std::string>(absl::StrSplit(text, ' '))) {
    if (column > 0 && column + 1 + word.size() > kColumns) {
      wrapped += '\n';
      column = 0;
    } else if (column > 0) {
      wrapped += ' ';
      ++column;
    }
    wrapped += word;
    column += word.size();
  }
  return wrapped;
}

namespace {

const char* Title(OptionGroup group) {
  switch (group) {
    case OptionGroup::kGrid: return "Grid";
    case OptionGroup::kValues: return "Voxels and values";
    case OptionGroup::kExecution: return kExecutionGroup;
  }
  return "";
}

}  // namespace

void AddRequestFlags(Command& command, RequestOptions& request) {
  for (const RequestOption& option : ListRequestOptions()) {
    const std::string flag = absl::StrCat("--", absl::StrReplaceAll(std::string(option.name), {{"_", "-"}}));
    const std::string text = Wrapped(std::string(option.text));
    std::visit(
        [&](auto field) {
          auto& value = request.*field;
          using Value = std::remove_reference_t<decltype(value)>;
          if constexpr (std::is_same_v<Value, bool>) {
            command.AddFlag(flag, value, text).Group(Title(option.group));
          } else {
            Option added =
                command.AddOption(flag, value, text).Group(Title(option.group)).Type(std::string(option.type));
            if constexpr (std::is_same_v<Value, std::vector<std::string>>) added.Repeatable();
          }
        },
        option.value);
  }
}

}  // namespace voxelpipe::cli
