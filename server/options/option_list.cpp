#include "options/option_list.h"

#include <algorithm>
#include <map>

#include "base/nearest_name.h"
#include "options/option_sources.h"

namespace voxelpipe {
namespace {

constexpr uint64_t kMaxBytes = uint64_t{1} << 60;

const std::map<std::string, uint64_t> kTimeUnits = {{"ms", 1}, {"s", 1000}, {"m", 60'000}, {"h", 3'600'000}};

// The error in the text of an unsigned number; empty if valid.
std::string CheckNotNegative(std::string& text) {
  return text.find('-') == std::string::npos ? "" : "must not be negative: " + text;
}

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

std::string DefaultOf(const CLI::Option& option) {
  if (option.get_type_name() == "BOOLEAN") return option.as<bool>() ? "true" : "false";
  const std::string text = option.get_default_str();
  return text.empty() ? "none" : text;
}

}  // namespace

void OptionList::Note(CLI::Option* option, const std::string& unit, const std::string& suffix) {
  option->group(group_);
  if (!unit.empty()) option->type_name(unit);
  entries_.push_back({option, group_, unit, suffix});
}

void OptionList::RefuseNegative(CLI::Option* option, bool refuse) {
  if (refuse) option->transform(CLI::Validator(CheckNotNegative, ""));
}

CLI::Option* OptionList::Add(const std::string& flag, std::string& value, const std::string& unit,
                             const std::string& text) {
  CLI::Option* const option = app_.add_option(flag, value, text);
  Note(option, unit, "");
  return option;
}

CLI::Option* OptionList::Add(const std::string& flag, bool& value, const std::string& text) {
  CLI::Option* const option = app_.add_option(flag, value, text);
  Note(option, "", "");
  return option;
}

CLI::Option* OptionList::AddChoice(const std::string& flag, std::string& value, const std::vector<std::string>& choices,
                                   const std::string& text) {
  CLI::Option* const option = app_.add_option(flag, value, text)
                                  ->check(CLI::Validator(
                                      [choices](std::string& text) -> std::string {
                                        if (std::find(choices.begin(), choices.end(), text) != choices.end()) return "";
                                        return UnknownChoice(text, choices);
                                      },
                                      ""));
  std::string list;
  for (const std::string& choice : choices) list += (list.empty() ? " (`" : ", `") + choice + "`";
  Note(option, "", list + ")");
  return option;
}

CLI::Option* OptionList::AddDuration(const std::string& flag, uint32_t& value, uint32_t max_ms,
                                     const std::string& text) {
  CLI::Option* const option = app_.add_option(flag, value, text)
                                  ->transform(CLI::AsNumberWithUnit(kTimeUnits))
                                  ->check(Between(uint32_t{0}, max_ms));
  RefuseNegative(option, true);
  Note(option, "ms", " (0 to " + std::to_string(max_ms) + ")");
  return option;
}

CLI::Option* OptionList::AddBytes(const std::string& flag, uint64_t& value, const std::string& text) {
  return AddSize(flag, value, 0, kMaxBytes, text, "");
}

CLI::Option* OptionList::AddBytes(const std::string& flag, uint64_t& value, uint64_t min, const std::string& text) {
  return AddSize(flag, value, min, kMaxBytes, text, " (at least " + std::to_string(min) + ")");
}

CLI::Option* OptionList::AddBytes(const std::string& flag, uint64_t& value, uint64_t min, uint64_t max,
                                  const std::string& text) {
  return AddSize(flag, value, min, max, text, " (" + std::to_string(min) + " to " + std::to_string(max) + ")");
}

CLI::Option* OptionList::AddSize(const std::string& flag, uint64_t& value, uint64_t min, uint64_t max,
                                 const std::string& text, const std::string& suffix) {
  CLI::Option* const option =
      app_.add_option(flag, value, text)->transform(CLI::AsSizeValue(false))->check(Between(min, max));
  RefuseNegative(option, true);
  Note(option, "bytes", suffix);
  return option;
}

CLI::Option* OptionList::AddCommand(CLI::Option* option) {
  option->configurable(false);
  Note(option, "", "");
  return option;
}

std::string OptionList::ToMarkdown() const {
  std::string tables, group;
  for (const auto& [option, of_group, unit, suffix] : entries_) {
    const bool configurable = option->get_configurable();
    if (of_group != group) {
      if (!group.empty()) tables += "<!-- /options -->\n";
      group = of_group;
      tables += "<!-- options: " + group + " -->\n";
      tables += configurable ? "| flag | variable | default | unit | meaning |\n| --- | --- | --- | --- | --- |\n"
                             : "| flag | meaning |\n| --- | --- |\n";
    }
    const std::string flag = "--" + option->get_lnames()[0];
    tables += "| `" + flag + "` | ";
    if (configurable) {
      const std::string of_kind = option->get_type_name() == "BOOLEAN" ? "bool" : unit;
      tables += "`" + VariableOf(flag) + "` | " + DefaultOf(*option) + " | " + of_kind + " | ";
    }
    tables += MarkFlags(option->get_description()) + suffix + " |\n";
  }
  return tables + "<!-- /options -->\n";
}

}  // namespace voxelpipe
