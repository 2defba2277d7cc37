// The command line of a program: its commands, and options that set variables of the program.
//
// A file that includes CLI11 takes many seconds longer to compile, so command.cpp alone does.
#pragma once

#include <cstdint>
#include <functional>
#include <istream>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace voxelpipe {

template <typename... Types>
using ReferenceToOneOf = std::variant<std::reference_wrapper<Types>...>;

// A variable that an option sets: variables of these types convert to it. It must outlive the program's parsing.
using ValueRef =
    ReferenceToOneOf<std::string, bool, int, int64_t, uint32_t, uint64_t, double, std::vector<std::string>,
                     std::optional<std::string>, std::optional<int>, std::optional<int64_t>, std::optional<double>>;

// In: a value as typed. Out: the error in it, empty if it is valid.
using ValueCheck = std::function<std::string(const std::string& text)>;

// An option or a positional argument, while its program exists. What sets a property returns the same option.
class Option {
 public:
  explicit Option(CLI::Option* option) : option_(option) {}

  // The heading in the help that it stands below.
  Option Group(const std::string& title);
  // What the help shows for its value.
  Option Type(const std::string& type);
  Option Required();
  // How many values it takes each time it is given.
  Option Values(int min, int max);
  // One value each time it is given, of a list that has them all.
  Option Repeatable();
  // A value is split at these.
  Option Delimiter(char delimiter);
  Option Needs(Option other);
  Option Excludes(Option other);
  // False: only for the command line, not for config files.
  Option Configurable(bool configurable);

  // Checks run in the order of these calls. `type` is appended to what the help shows for the value.
  Option Check(ValueCheck check, const std::string& type = "");
  Option Choices(const std::vector<std::string>& choices);
  // A number within both limits. Where `min` is not negative a minus sign is refused before all other checks: CLI11
  // takes unsigned numbers modulo 2^64.
  Option Between(int64_t min, int64_t max);
  Option Between(uint64_t min, uint64_t max);
  // A number that may have one of these units, by which it is multiplied, before the checks that were added so far.
  Option Units(const std::map<std::string, uint64_t>& units);
  // The same for sizes in bytes: 64MiB, 2G.
  Option ByteUnits();

  // The first long name, otherwise the short one, with dashes; of an argument its name.
  std::string name() const;
  // All names with dashes, the short ones first; of an argument its one name.
  std::vector<std::string> names() const;
  // Without dashes.
  const std::vector<std::string>& long_names() const;
  bool positional() const;
  bool required() const;
  bool configurable() const;
  // 0 for flags.
  int max_values() const;
  const std::string& group() const;
  const std::string& description() const;
  // With what checks appended to it.
  std::string type() const;
  // The value of the variable when the option was added, if the program shows defaults.
  std::string default_text() const;
  // Of the last parsing: how many values were given, and the last of them.
  size_t count() const;
  const std::string& value() const;
  // True for options that set a bool and take a value; then the value that was given, otherwise the default.
  bool is_bool() const;
  bool bool_value() const;

 private:
  CLI::Option* option_;
};

// A program or one of its subcommands, while the program exists.
class Command {
 public:
  explicit Command(CLI::App* app) : app_(app) {}

  // `names` are separated by commas; a name without dashes is a positional argument.
  Option AddOption(const std::string& names, ValueRef value, const std::string& text);
  Option AddFlag(const std::string& names, bool& value, const std::string& text);
  Command AddCommand(const std::string& name, const std::string& text);
  // The end of its help.
  void SetFooter(const std::string& text);
  // Runs when a command line with this command was parsed.
  void SetCallback(std::function<void()> callback);

  const std::string& name() const;
  std::string description() const;
  std::string footer() const;
  // In the order of the help.
  std::vector<Option> options() const;
  std::vector<Command> commands() const;
  // The option with this name, given with its dashes.
  std::optional<Option> FindOption(const std::string& name) const;

 protected:
  CLI::App* app_;
};

// Why a program does not run as its command line says.
struct ParseStop {
  enum class Kind : uint8_t {
    kAnswered,    // --help or --version: no error
    kUnexpected,  // a part is no option and no argument
    kCount,       // an option has too few or too many values
    kConversion,  // a value cannot be converted to the variable's type
    kCheck,       // a check refused a value: "--option: reason"
    kOther,
  };
  Kind kind = Kind::kOther;
  std::string text;  // of kAnswered what is to be printed, otherwise the error as CLI11 puts it (see usage_error.h)
};

class Program : public Command {
 public:
  Program(const std::string& name, const std::string& text, const std::string& version);
  ~Program();
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  // One of its commands has to be given.
  void RequireCommand();
  // Options that are added from now on show their default in the help.
  void ShowDefaults();

  // In: what follows the program's name. Sets the variables and runs the callback of the command that was given. May be
  // called again. Out: nothing if all is done.
  std::optional<ParseStop> Parse(std::vector<std::string> arguments);
  // Of the last parsing: the command that was given, and the parts that were not expected.
  std::optional<Command> given() const;
  std::vector<std::string> unexpected() const;

 private:
  std::unique_ptr<CLI::App> owned_;
};

// An assignment in a config file (TOML).
struct ConfigItem {
  std::string key;  // with the names of its sections before it: "section.key"
  bool in_section = false;
  std::vector<std::string> values;
};
std::vector<ConfigItem> ReadConfigItems(std::istream& file);

}  // namespace voxelpipe
