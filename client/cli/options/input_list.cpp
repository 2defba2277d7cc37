#include "options/input_list.h"

#include <fnmatch.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "encode/encode.h"
#include "load/decode/mesh_format.h"
#include "options/standard_streams.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;

template <typename... Parts>
absl::Status Wrong(const Parts&... parts) {
  return absl::InvalidArgumentError(absl::StrCat(parts...));
}

bool IsMeshName(const fs::path& path) {
  return MeshFormatOfName(path.string()).has_value();
}

bool HasWildcard(const std::string& text) {
  return text.find_first_of("*?[") != std::string::npos;
}

std::string NameOf(const fs::path& below) {
  const fs::path stem = below.stem();
  return (below.parent_path() / (stem.empty() ? fs::path("mesh") : stem)).string();
}

// Collects the files that a directory or pattern stands for.
class Finder {
 public:
  explicit Finder(fs::path base) : base_(std::move(base)) {}

  // The meshes in base/below, and those of its directories if `recursive`.
  absl::Status AddDirectory(const fs::path& below, bool recursive) {
    return ForEach(below, [&](const fs::directory_entry& entry, const fs::path& at) -> absl::Status {
      if (Hidden(at)) return absl::OkStatus();
      if (IsFile(entry) && IsMeshName(at)) Add(at);
      return recursive && IsOwnDirectory(entry) ? AddDirectory(at, true) : absl::OkStatus();
    });
  }

  // The files in base/below that the parts from `part` on match.
  absl::Status AddMatches(const fs::path& below, const std::vector<std::string>& parts, size_t part) {
    const std::string& pattern = parts[part];
    const bool last = part + 1 == parts.size();
    if (pattern == "**") {
      if (absl::Status s = last ? AddDirectory(below, false) : AddMatches(below, parts, part + 1); !s.ok()) return s;
      return ForEach(below, [&](const fs::directory_entry& entry, const fs::path& at) {
        return !Hidden(at) && IsOwnDirectory(entry) ? AddMatches(at, parts, part) : absl::OkStatus();
      });
    }
    const bool meshes_only = last && pattern.find('.') == std::string::npos;
    return ForEach(below, [&](const fs::directory_entry& entry, const fs::path& at) -> absl::Status {
      if (fnmatch(pattern.c_str(), at.filename().c_str(), FNM_PERIOD) != 0) return absl::OkStatus();
      std::error_code ignored;  // what cannot be examined does not match
      if (!last) return entry.is_directory(ignored) ? AddMatches(at, parts, part + 1) : absl::OkStatus();
      if (IsFile(entry) && (!meshes_only || IsMeshName(at))) Add(at);
      return absl::OkStatus();
    });
  }

  // In order; each file once, though `**` may find it by several ways.
  std::vector<InputFile> Take() {
    std::sort(files_.begin(), files_.end(), [](const auto& a, const auto& b) { return a.path < b.path; });
    const auto same = [](const auto& a, const auto& b) { return a.path == b.path; };
    files_.erase(std::unique(files_.begin(), files_.end(), same), files_.end());
    return std::move(files_);
  }

 private:
  static bool Hidden(const fs::path& path) { return path.filename().string().starts_with('.'); }
  static bool IsFile(const fs::directory_entry& entry) {
    std::error_code ignored;
    return entry.is_regular_file(ignored);
  }
  // Not through a link, which may lead into a circle.
  static bool IsOwnDirectory(const fs::directory_entry& entry) {
    std::error_code ignored;
    return entry.is_directory(ignored) && !entry.is_symlink(ignored);
  }

  void Add(const fs::path& below) { files_.push_back({(base_ / below).string(), NameOf(below)}); }

  template <typename Visit>
  absl::Status ForEach(const fs::path& below, const Visit& visit) {
    const fs::path directory = base_ / below;
    std::error_code error;
    fs::directory_iterator it(directory.empty() ? fs::path(".") : directory, error);
    for (; !error && it != fs::directory_iterator(); it.increment(error)) {
      if (absl::Status s = visit(*it, below / it->path().filename()); !s.ok()) return s;
    }
    // A pattern may name a directory that is not there: it matches nothing.
    if (!error || error == std::errc::no_such_file_or_directory) return absl::OkStatus();
    return Wrong(directory.string(), ": cannot be listed: ", error.message());
  }

  const fs::path base_;
  std::vector<InputFile> files_;
};

absl::StatusOr<std::vector<InputFile>> FromDirectory(const std::string& directory, bool recursive) {
  Finder finder(directory);
  if (absl::Status s = finder.AddDirectory("", recursive); !s.ok()) return s;
  std::vector<InputFile> files = finder.Take();
  if (!files.empty()) return files;
  return Wrong(directory, ": no mesh (.glb, .gltf, .drc, .stl, .ply, .off, .obj, .3mf) in this directory",
               recursive ? " or below it" : "; --recursive also looks below it");
}

absl::StatusOr<std::vector<InputFile>> FromPattern(const std::string& pattern) {
  fs::path base;
  std::vector<std::string> parts;
  for (const fs::path& part : fs::path(pattern)) {
    if (part.empty()) continue;  // after a '/' at the end
    if (parts.empty() && !HasWildcard(part.string())) {
      base /= part;
    } else {
      parts.push_back(part.string());
    }
  }
  Finder finder(base);
  if (absl::Status s = finder.AddMatches("", parts, 0); !s.ok()) return s;
  std::vector<InputFile> files = finder.Take();
  if (!files.empty()) return files;
  return Wrong("no file matches '", pattern, "'; '**' looks into all directories, as in 'meshes/**/*.glb'");
}

}  // namespace

absl::StatusOr<InputList> ExpandInputs(const std::vector<std::string>& typed, bool recursive) {
  InputList list;
  bool any_directory = false;
  for (const std::string& text : typed) {
    std::error_code ignored;  // a file that cannot be examined is one to be read, which reports the error
    const bool directory = fs::is_directory(text, ignored);
    any_directory = any_directory || directory;
    if (!directory && (!HasWildcard(text) || fs::exists(text, ignored))) {
      list.files.push_back({text, IsStandardStream(text) ? "stdin" : NameOf(fs::path(text).filename())});
      continue;
    }
    list.open_ended = true;
    absl::StatusOr<std::vector<InputFile>> files = directory ? FromDirectory(text, recursive) : FromPattern(text);
    if (!files.ok()) return files.status();
    std::move(files->begin(), files->end(), std::back_inserter(list.files));
  }
  if (recursive && !any_directory) return Wrong("--recursive: there is no directory among the inputs");
  return list;
}

}  // namespace voxelpipe::cli
