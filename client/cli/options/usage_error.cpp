#include "options/usage_error.h"

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <vector>

#include "absl/strings/str_cat.h"
#include "base/nearest_name.h"
#include "options/standard_streams.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;

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

// The option that a part of the command line was probably meant to be.
std::string NearestOption(const CLI::App& command, const std::string& typed) {
  std::vector<std::string> known;
  for (const CLI::Option* option : command.get_options()) {
    for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
  }
  return InBrackets(DidYouMean(typed.substr(0, typed.find('=')), known));
}

}  // namespace

std::string UsageError(const CLI::App& app, const CLI::ParseError& error) {
  const std::vector<CLI::App*> given = app.get_subcommands();
  const std::vector<std::string> unknown = app.remaining(true);
  std::string text = error.what();
  if (given.empty()) {
    if (!unknown.empty() && !unknown.front().starts_with('-')) text = NoCommand(app, unknown.front());
    return absl::StrCat(text, "; see 'voxelpipe --help'");
  }
  for (const std::string& typed : unknown) {
    if (typed.starts_with("--")) absl::StrAppend(&text, NearestOption(*given.front(), typed));
  }
  return absl::StrCat(text, "; see 'voxelpipe ", given.front()->get_name(), " --help'");
}

std::string MissingFileHint(const std::string& path) {
  constexpr int kMaxEntries = 10000;  // of a directory: a hint is not worth more
  std::error_code error;
  if (IsStandardStream(path) || fs::exists(path, error)) return "";
  const fs::path directory = fs::path(path).parent_path();
  if (!directory.empty() && !fs::is_directory(directory, error)) {
    return absl::StrCat(" (there is no directory '", directory.string(), "')");
  }
  std::vector<std::string> names;
  fs::directory_iterator it(directory.empty() ? fs::path(".") : directory, error);
  for (; !error && it != fs::directory_iterator() && names.size() < kMaxEntries; it.increment(error)) {
    if (it->is_regular_file(error)) names.push_back(it->path().filename().string());
  }
  std::sort(names.begin(), names.end());  // a directory's order is any
  const std::string nearest = NearestName(fs::path(path).filename().string(), names);
  return nearest.empty() ? "" : absl::StrCat(" (did you mean '", (directory / nearest).string(), "'?)");
}

}  // namespace voxelpipe::cli
