#include "options/option_list.h"

#include <algorithm>
#include <map>

#include "base/nearest_name.h"
#include "options/option_sources.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kMaxBytes = uint64_t{1} << 60;

const std::map<std::string, uint64_t> kTimeUnits = {{"ms", 1}, {"s", 1000}, {"m", 60'000}, {"h", 3'600'000}};

// The text with each flag in it marked as code.
std::string MarkFlags(const std::string& text) {
  std::string marked;
  for (size_t at = 0; at < text.size();) {
    size_t end = at;
    if (text.compare(at, 2, "--") == 0) {
      end = text.find_first_not_of("abcdefghijklmnopqrstuvwxyz-", at);
      if (end == std::string::npos) end = text.size();
    }
    marked += end > at ? "`" + text.substr(at, end - at) + "`" : text.substr(at, 1);
    at = end > at ? end : at + 1;
  }
  return marked;
}

std::string DefaultOf(const Option& option) {
  if (option.is_bool()) return option.bool_value() ? "true" : "false";
  const std::string text = option.default_text();
  return text.empty() ? "none" : text;
}

template <typename Number>
std::string FromTo(Number min, Number max) {
  return " (" + std::to_string(min) + " to " + std::to_string(max) + ")";
}

}  // namespace

Option OptionList::Note(Option option, const std::string& unit, const std::string& suffix) {
  option.Group(group_);
  if (!unit.empty()) option.Type(unit);
  entries_.push_back({option, group_, unit, suffix});
  return option;
}

Option OptionList::Add(const std::string& flag, std::string& value, const std::string& unit, const std::string& text) {
  return Note(command_.AddOption(flag, value, text), unit, "");
}

Option OptionList::Add(const std::string& flag, bool& value, const std::string& text) {
  return Note(command_.AddOption(flag, value, text), "", "");
}

Option OptionList::AddChoice(const std::string& flag, std::string& value, const std::vector<std::string>& choices,
                             const std::string& text) {
  const Option option =
      command_.AddOption(flag, value, text).Check([choices](const std::string& choice) -> std::string {
        if (std::find(choices.begin(), choices.end(), choice) != choices.end()) return "";
        return UnknownChoice(choice, choices);
      });
  std::string list;
  for (const std::string& choice : choices) list += (list.empty() ? " (`" : ", `") + choice + "`";
  return Note(option, "", list + ")");
}

Option OptionList::AddNumber(const std::string& flag, int& value, int min, int max, const std::string& unit,
                             const std::string& text) {
  return Note(command_.AddOption(flag, value, text).Between(int64_t{min}, int64_t{max}), unit, FromTo(min, max));
}

Option OptionList::AddNumber(const std::string& flag, uint32_t& value, uint32_t min, uint32_t max,
                             const std::string& unit, const std::string& text) {
  return Note(command_.AddOption(flag, value, text).Between(uint64_t{min}, uint64_t{max}), unit, FromTo(min, max));
}

Option OptionList::AddNumber(const std::string& flag, uint64_t& value, uint64_t min, uint64_t max,
                             const std::string& unit, const std::string& text) {
  return Note(command_.AddOption(flag, value, text).Between(min, max), unit, FromTo(min, max));
}

Option OptionList::AddDuration(const std::string& flag, uint32_t& value, uint32_t max_ms, const std::string& text) {
  const Option option = command_.AddOption(flag, value, text).Units(kTimeUnits).Between(uint64_t{0}, uint64_t{max_ms});
  return Note(option, "ms", FromTo(0u, max_ms));
}

Option OptionList::AddBytes(const std::string& flag, uint64_t& value, const std::string& text) {
  return AddSize(flag, value, 0, kMaxBytes, text, "");
}

Option OptionList::AddBytes(const std::string& flag, uint64_t& value, uint64_t min, const std::string& text) {
  return AddSize(flag, value, min, kMaxBytes, text, " (at least " + std::to_string(min) + ")");
}

Option OptionList::AddBytes(const std::string& flag, uint64_t& value, uint64_t min, uint64_t max,
                            const std::string& text) {
  return AddSize(flag, value, min, max, text, FromTo(min, max));
}

Option OptionList::AddSize(const std::string& flag, uint64_t& value, uint64_t min, uint64_t max,
                           const std::string& text, const std::string& suffix) {
  return Note(command_.AddOption(flag, value, text).ByteUnits().Between(min, max), "bytes", suffix);
}

Option OptionList::AddCommand(Option option) {
  return Note(option.Configurable(false), "", "");
}

std::string OptionList::ToMarkdown() const {
  std::string tables, group;
  for (const auto& [option, of_group, unit, suffix] : entries_) {
    const bool configurable = option.configurable();
    if (of_group != group) {
      if (!group.empty()) tables += "<!-- /options -->\n";
      group = of_group;
      tables += "<!-- options: " + group + " -->\n";
      tables += configurable ? "| flag | variable | default | unit | meaning |\n| --- | --- | --- | --- | --- |\n"
                             : "| flag | meaning |\n| --- | --- |\n";
    }
    const std::string flag = "--" + option.long_names()[0];
    tables += "| `" + flag + "` | ";
    if (configurable) {
      const std::string of_kind = option.is_bool() ? "bool" : unit;
      tables += "`" + VariableOf(flag) + "` | " + DefaultOf(option) + " | " + of_kind + " | ";
    }
    tables += MarkFlags(option.description()) + suffix + " |\n";
  }
  return tables + "<!-- /options -->\n";
}

}  // namespace voxelpipe
