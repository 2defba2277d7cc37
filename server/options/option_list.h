// Options as a program declares them: CLI11 parses them, --help and the tables of OPERATIONS.md show the same texts.
#pragma once

#include <concepts>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

namespace voxelpipe {

class OptionList {
 public:
  // Adds options to `app`, which must outlive this list.
  explicit OptionList(CLI::App& app) : app_(app) {}

  // The following options belong to this group.
  void Group(const std::string& title) { group_ = title; }

  // Each of these adds an option that sets `value`, whose current value is the default. `unit` is that of its value, ""
  // if it has none; `text` describes it, in lower case and without a full stop at the end.
  CLI::Option* Add(const std::string& flag, std::string& value, const std::string& unit, const std::string& text);
  CLI::Option* Add(const std::string& flag, bool& value, const std::string& text);
  CLI::Option* AddChoice(const std::string& flag, std::string& value, const std::vector<std::string>& choices,
                         const std::string& text);
  // A number from `min` to `max`, inclusive.
  template <std::integral Value>
  CLI::Option* AddNumber(const std::string& flag, Value& value, Value min, Value max, const std::string& unit,
                         const std::string& text) {
    CLI::Option* const option = app_.add_option(flag, value, text);
    // The check added last runs first: CLI11 would take unsigned numbers modulo 2^64.
    option->check(Between(min, max));
    RefuseNegative(option, std::cmp_greater_equal(min, 0));
    Note(option, unit, " (" + std::to_string(min) + " to " + std::to_string(max) + ")");
    return option;
  }
  // The same in milliseconds, optionally with a unit (30m, 90s).
  CLI::Option* AddDuration(const std::string& flag, uint32_t& value, uint32_t max_ms, const std::string& text);
  // A size, optionally with a suffix (64MiB): from 0, from `min` or from `min` to `max` bytes.
  CLI::Option* AddBytes(const std::string& flag, uint64_t& value, const std::string& text);
  CLI::Option* AddBytes(const std::string& flag, uint64_t& value, uint64_t min, const std::string& text);
  CLI::Option* AddBytes(const std::string& flag, uint64_t& value, uint64_t min, uint64_t max, const std::string& text);

  // Options for the command line alone: no variable and no key of the config file sets them.
  CLI::Option* AddCommand(CLI::Option* option);

  // A table for each group between two comments that name it, for OPERATIONS.md.
  std::string ToMarkdown() const;

 private:
  // CLI11's check in words that name both limits.
  template <typename Value>
  static CLI::Validator Between(Value min, Value max) {
    return CLI::Validator(
        [min, max](std::string& text) -> std::string {
          if (CLI::Range(min, max)(text).empty()) return "";
          return "'" + text + "' is no number from " + std::to_string(min) + " to " + std::to_string(max);
        },
        "");
  }

  struct Entry {
    const CLI::Option* option;
    std::string group, unit, suffix;
  };
  void Note(CLI::Option* option, const std::string& unit, const std::string& suffix);
  static void RefuseNegative(CLI::Option* option, bool refuse);
  CLI::Option* AddSize(const std::string& flag, uint64_t& value, uint64_t min, uint64_t max, const std::string& text,
                       const std::string& suffix);

  CLI::App& app_;
  std::string group_;
  std::vector<Entry> entries_;
};

}  // namespace voxelpipe
