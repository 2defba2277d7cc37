// Options as a program declares them: CLI11 parses them, --help and the tables of OPERATIONS.md show the same texts.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "command_line/command.h"

namespace voxelpipe {

class OptionList {
 public:
  // Adds options to `command`, which must outlive this list.
  explicit OptionList(Command& command) : command_(command) {}

  // The following options belong to this group.
  void Group(const std::string& title) { group_ = title; }

  // Each of these adds an option that sets `value`, whose current value is the default. `unit` is that of its value, ""
  // if it has none; `text` describes it, in lower case and without a full stop at the end.
  Option Add(const std::string& flag, std::string& value, const std::string& unit, const std::string& text);
  Option Add(const std::string& flag, bool& value, const std::string& text);
  Option AddChoice(const std::string& flag, std::string& value, const std::vector<std::string>& choices,
                   const std::string& text);
  // A number from `min` to `max`, inclusive.
  Option AddNumber(const std::string& flag, int& value, int min, int max, const std::string& unit,
                   const std::string& text);
  Option AddNumber(const std::string& flag, uint32_t& value, uint32_t min, uint32_t max, const std::string& unit,
                   const std::string& text);
  Option AddNumber(const std::string& flag, uint64_t& value, uint64_t min, uint64_t max, const std::string& unit,
                   const std::string& text);
  // The same in milliseconds, optionally with a unit (30m, 90s).
  Option AddDuration(const std::string& flag, uint32_t& value, uint32_t max_ms, const std::string& text);
  // A size, optionally with a suffix (64MiB): from 0, from `min` or from `min` to `max` bytes.
  Option AddBytes(const std::string& flag, uint64_t& value, const std::string& text);
  Option AddBytes(const std::string& flag, uint64_t& value, uint64_t min, const std::string& text);
  Option AddBytes(const std::string& flag, uint64_t& value, uint64_t min, uint64_t max, const std::string& text);

  // Options for the command line alone: no variable and no key of the config file sets them.
  Option AddCommand(Option option);

  // A table for each group between two comments that name it, for OPERATIONS.md.
  std::string ToMarkdown() const;

 private:
  struct Entry {
    Option option;
    std::string group, unit, suffix;
  };
  Option Note(Option option, const std::string& unit, const std::string& suffix);
  Option AddSize(const std::string& flag, uint64_t& value, uint64_t min, uint64_t max, const std::string& text,
                 const std::string& suffix);

  Command& command_;
  std::string group_;
  std::vector<Entry> entries_;
};

}  // namespace voxelpipe
