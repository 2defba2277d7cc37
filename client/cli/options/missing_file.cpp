#include "options/missing_file.h"

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

}  // namespace

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
