#include "command_line/command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <sstream>
#include <utility>

namespace voxelpipe {
namespace {

std::string CheckNotNegative(const std::string& text) {
  return text.find('-') == std::string::npos ? "" : "must not be negative: " + text;
}

// CLI11's check in words that name both limits.
template <typename Number>
void AddRange(CLI::Option& option, Number min, Number max) {
  option.check([min, max](const std::string& text) -> std::string {
    std::string number = text;
    if (CLI::Range(min, max)(number).empty()) return "";
    return "'" + text + "' is no number from " + std::to_string(min) + " to " + std::to_string(max);
  });
  if (min < 0) return;
  option.transform(CLI::Validator(CheckNotNegative, ""));  // before all other checks
}

ParseStop::Kind KindOf(const CLI::ParseError& error) {
  using Kind = ParseStop::Kind;
  if (error.get_exit_code() == 0) return Kind::kAnswered;
  if (dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr) return Kind::kUnexpected;
  if (dynamic_cast<const CLI::ArgumentMismatch*>(&error) != nullptr) return Kind::kCount;
  if (dynamic_cast<const CLI::ConversionError*>(&error) != nullptr) return Kind::kConversion;
  if (dynamic_cast<const CLI::ValidationError*>(&error) != nullptr) return Kind::kCheck;
  return Kind::kOther;
}

}  // namespace

Option Option::Group(const std::string& title) {
  option_->group(title);
  return *this;
}

Option Option::Type(const std::string& type) {
  option_->type_name(type);
  return *this;
}

Option Option::Required() {
  option_->required();
  return *this;
}

Option Option::Values(int min, int max) {
  option_->expected(min, max);
  return *this;
}

Option Option::Repeatable() {
  option_->allow_extra_args(false)->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  return *this;
}

Option Option::Delimiter(char delimiter) {
  option_->delimiter(delimiter);
  return *this;
}

Option Option::Needs(Option other) {
  option_->needs(other.option_);
  return *this;
}

Option Option::Excludes(Option other) {
  option_->excludes(other.option_);
  return *this;
}

Option Option::Configurable(bool configurable) {
  option_->configurable(configurable);
  return *this;
}

Option Option::Check(ValueCheck check, const std::string& type) {
  option_->check(std::move(check), type);
  return *this;
}

Option Option::Choices(const std::vector<std::string>& choices) {
  option_->check(CLI::IsMember(choices));
  return *this;
}

Option Option::Between(int64_t min, int64_t max) {
  AddRange(*option_, min, max);
  return *this;
}

Option Option::Between(uint64_t min, uint64_t max) {
  AddRange(*option_, min, max);
  return *this;
}

Option Option::Units(const std::map<std::string, uint64_t>& units) {
  option_->transform(CLI::AsNumberWithUnit(units));
  return *this;
}

Option Option::ByteUnits() {
  option_->transform(CLI::AsSizeValue(false));
  return *this;
}

std::string Option::name() const {
  return option_->get_name();
}

std::vector<std::string> Option::names() const {
  std::vector<std::string> names;
  for (const std::string& name : option_->get_snames()) names.push_back("-" + name);
  for (const std::string& name : option_->get_lnames()) names.push_back("--" + name);
  if (positional()) names = {option_->get_name(true)};
  return names;
}

const std::vector<std::string>& Option::long_names() const {
  return option_->get_lnames();
}

bool Option::positional() const {
  return option_->get_positional();
}

bool Option::required() const {
  return option_->get_required();
}

bool Option::configurable() const {
  return option_->get_configurable();
}

int Option::max_values() const {
  return option_->get_expected_max();
}

const std::string& Option::group() const {
  return option_->get_group();
}

const std::string& Option::description() const {
  return option_->get_description();
}

std::string Option::type() const {
  return option_->get_type_name();
}

std::string Option::default_text() const {
  return option_->get_default_str();
}

size_t Option::count() const {
  return option_->count();
}

const std::string& Option::value() const {
  return option_->results().back();
}

bool Option::is_bool() const {
  return option_->get_type_name() == "BOOLEAN";
}

bool Option::bool_value() const {
  return option_->as<bool>();
}

Option Command::AddOption(const std::string& names, ValueRef value, const std::string& text) {
  return Option(std::visit([&](auto variable) { return app_->add_option(names, variable.get(), text); }, value));
}

Option Command::AddFlag(const std::string& names, bool& value, const std::string& text) {
  return Option(app_->add_flag(names, value, text));
}

Command Command::AddCommand(const std::string& name, const std::string& text) {
  return Command(app_->add_subcommand(name, text));
}

void Command::SetFooter(const std::string& text) {
  app_->footer(text);
}

void Command::SetCallback(std::function<void()> callback) {
  app_->callback(std::move(callback));
}

const std::string& Command::name() const {
  return app_->get_name();
}

std::string Command::description() const {
  return app_->get_description();
}

std::string Command::footer() const {
  return app_->get_footer();
}

std::vector<Option> Command::options() const {
  const std::vector<CLI::Option*> options = app_->get_options();
  return {options.begin(), options.end()};
}

std::vector<Command> Command::commands() const {
  const std::vector<CLI::App*> commands = app_->get_subcommands([](CLI::App*) { return true; });
  return {commands.begin(), commands.end()};
}

std::optional<Option> Command::FindOption(const std::string& name) const {
  CLI::Option* const option = app_->get_option_no_throw(name);
  return option == nullptr ? std::nullopt : std::optional(Option(option));
}

Program::Program(const std::string& name, const std::string& text, const std::string& version)
    : Command(new CLI::App(text, name)), owned_(app_) {
  app_->set_version_flag("--version", version);
}

Program::~Program() = default;

void Program::RequireCommand() {
  app_->require_subcommand(1);
}

void Program::ShowDefaults() {
  app_->option_defaults()->always_capture_default();
}

std::optional<ParseStop> Program::Parse(std::vector<std::string> arguments) {
  std::reverse(arguments.begin(), arguments.end());
  try {
    app_->parse(std::move(arguments));
  } catch (const CLI::ParseError& error) {
    const ParseStop::Kind kind = KindOf(error);
    if (kind != ParseStop::Kind::kAnswered) return ParseStop{kind, error.what()};
    std::ostringstream answer;
    app_->exit(error, answer, answer);
    return ParseStop{kind, answer.str()};
  }
  return std::nullopt;
}

std::optional<Command> Program::given() const {
  const std::vector<CLI::App*> given = app_->get_subcommands();
  return given.empty() ? std::nullopt : std::optional(Command(given.front()));
}

std::vector<std::string> Program::unexpected() const {
  return app_->remaining(true);
}

std::vector<ConfigItem> ReadConfigItems(std::istream& file) {
  std::vector<ConfigItem> items;
  for (const CLI::ConfigItem& item : CLI::ConfigTOML().from_config(file)) {
    if (item.name == "++" || item.name == "--") continue;  // begin and end of a section
    items.push_back({item.fullname(), !item.parents.empty(), item.inputs});
  }
  return items;
}

}  // namespace voxelpipe
