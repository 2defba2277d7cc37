// The commands and options of the program, as its completion scripts and its manual page need them.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace voxelpipe {
class Command;
}

namespace voxelpipe::cli {

// What a value may be.
enum class ValueKind : uint8_t {
  kNone,       // a flag
  kFree,       // any text: nothing is proposed
  kChoice,     // one of OptionModel::choices
  kFile,       // a path
  kDirectory,  // the path of a directory
};

struct OptionModel {
  std::vector<std::string> names;  // with dashes, the short ones first; of an argument its one name without
  ValueKind kind = ValueKind::kNone;
  std::string type;  // as the help shows it: "tight|cube"; empty for flags and arguments
  std::vector<std::string> choices;
  bool repeatable = false;
  bool required = false;
  std::string group;
  std::string help;  // one line
};

struct CommandModel {
  std::string name, help;
  std::string footer;
  std::vector<OptionModel> options, arguments;  // in the order of the help
};

struct ProgramModel {
  std::string name, help, footer;
  std::vector<OptionModel> options;  // before the command
  std::vector<CommandModel> commands;
};

// In: the complete program. Choices are those of a type "a|b|c"; of --shader and --vertex-shader the names in the
// catalog. Files are values of the types FILE, OUT and PNG and all arguments without choices, directories those of D.
ProgramModel ModelOf(const Command& program);

// Up to the end of the first sentence or clause: what fits beside a name. At most 72 bytes.
std::string FirstClause(const std::string& help);

}  // namespace voxelpipe::cli
