#include "load/pack_obj.h"

#include <climits>
#include <cstring>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "load/base/charged_growth.h"
#include "load/base/data_uri.h"
#include "load/base/text_reader.h"
#include "load/local_file.h"
#include "load/obj/map_statement.h"

namespace voxelpipe {
namespace {

namespace fs = std::filesystem;

constexpr std::string_view kLibraryWord = "mtllib";

// Percent escapes for what would end a word, a line or the URI's head.
std::string Escape(std::string_view text) {
  static constexpr char kHex[] = "0123456789ABCDEF";
  std::string out;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte > ' ' && byte < 127 && std::strchr("%#\\;,\"'", c) == nullptr) {
      out += c;
    } else {
      out += '%';
      out += kHex[byte >> 4];
      out += kHex[byte & 15];
    }
  }
  return out;
}

std::string MediaType(const fs::path& path) {
  const std::string name = path.extension().string();
  if (SameWord(name, ".jpg") || SameWord(name, ".jpeg")) return "image/jpeg";
  if (SameWord(name, ".webp")) return "image/webp";
  return SameWord(name, ".png") ? "image/png" : "application/octet-stream";
}

std::string_view TextOf(std::span<const uint8_t> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// Writes the packed file, each file that it names once.
class ObjPacker {
 public:
  ObjPacker(const JobContext& job, fs::path directory, const LoadLimits& limits, const OutsideFiles& outside)
      : job_(job), directory_(std::move(directory)), limits_(limits), outside_(outside), charge_(&MemoryOf(job)) {}

  absl::StatusOr<std::optional<FileBytes>> Pack(std::string_view text) {
    bool changed = false;
    size_t copied = 0;  // bytes of the text
    TextLines lines(text, job_);
    while (const std::optional<std::string_view> line = lines.Next()) {
      Words words(*line, &job_);
      if (words.Next() != kLibraryWord) continue;
      const std::string_view names = words.Rest();
      if (names.empty() || IsDataUri(names)) continue;
      const auto at = size_t(line->data() - text.data());
      if (absl::Status full = Append(text.substr(copied, at - copied)); !full.ok()) return full;
      copied = at;
      const absl::StatusOr<bool> written = Statement(names, absl::StrCat("line ", lines.number()));
      if (!written.ok()) return written.status();
      if (!*written) continue;
      copied += line->size();
      changed = true;
    }
    if (absl::Status over = job_.Check(); !over.ok()) return over;
    if (!changed) return std::optional<FileBytes>();
    if (absl::Status full = Append(text.substr(copied)); !full.ok()) return full;
    return std::optional<FileBytes>(std::move(out_));
  }

 private:
  absl::Status Append(std::string_view text) {
    if (text.size() > limits_.max_file_bytes || out_.size() > limits_.max_file_bytes - text.size()) {
      return absl::ResourceExhaustedError(
          absl::StrCat("the packed mesh would be larger than ", limits_.max_file_bytes, " bytes"));
    }
    if (absl::Status full = MakeChargedRoom(charge_, out_, text.size(), "the packed mesh:"); !full.ok()) return full;
    out_.insert(out_.end(), text.begin(), text.end());
    return absl::OkStatus();
  }

  // Appends what `write` makes of each part of the text.
  template <typename Write>
  absl::Status AppendInSteps(std::string_view text, const Write& write) {
    constexpr size_t kStep = 3 << 14;  // bytes between two polls of the job; whole groups of base64
    for (size_t at = 0; at < text.size(); at += kStep) {
      if (absl::Status over = job_.Check(); !over.ok()) return over;
      if (absl::Status full = Append(write(text.substr(at, kStep))); !full.ok()) return full;
    }
    return absl::OkStatus();
  }
  absl::Status AppendEscaped(std::string_view text) { return AppendInSteps(text, Escape); }

  // The path of a file; empty if there is none that is read. Errors: those of files outside, if `wanted`.
  absl::StatusOr<std::optional<fs::path>> Find(const std::string& name, bool wanted, const std::string& where) {
    const auto known = paths_.find(name);
    if (known != paths_.end()) return known->second;
    absl::StatusOr<SiblingFile> sibling = ResolveSiblingName(directory_, name);
    std::optional<fs::path> path;
    if (sibling.ok() && (sibling->outside.empty() || outside_.allowed)) {
      path = std::move(sibling->path);
    } else if (sibling.ok()) {
      std::error_code ignored;
      if (!wanted || !fs::exists(sibling->path, ignored)) return path;
      return absl::InvalidArgumentError(absl::StrCat(where, ": the file ", Quote(name), " ", sibling->outside,
                                                     ", and is read only where that is allowed (--allow-outside)"));
    }
    constexpr uint64_t kBytesAName = 256;  // in the table
    const uint64_t bytes = kBytesAName + 2 * (name.size() + (path ? path->native().size() : 0));
    if (absl::Status full = charge_.Grow(bytes, "names of files:"); !full.ok()) return full;
    paths_.emplace(name, path);
    return path;
  }

  // The bytes of a file; empty if it cannot be read, then `name` leads to none from now on.
  absl::StatusOr<std::optional<FileBytes>> Read(const std::string& name, const fs::path& path, MemoryCharge& charge) {
    absl::StatusOr<FileBytes> bytes = ReadSibling(path, limits_.max_file_bytes, charge);
    if (bytes.ok()) return std::optional<FileBytes>(*std::move(bytes));
    if (LimitErrorOf(bytes.status())) return bytes.status();
    paths_[name].reset();
    return std::optional<FileBytes>();
  }

  // Writes the statement for the libraries of a line: one name, which may hold spaces, or several. False if there is
  // nothing to change.
  absl::StatusOr<bool> Statement(std::string_view names, const std::string& where) {
    const size_t begin = out_.size();
    if (absl::Status full = Append(kLibraryWord); !full.ok()) return full;
    absl::StatusOr<bool> any = Library(names, where);
    if (!any.ok() || *any) return any;
    Words words(names, &job_);
    for (std::string_view word = words.Next(); !word.empty(); word = words.Next()) {
      const absl::StatusOr<bool> read = Library(word, where);
      if (!read.ok()) return read;
      any = *any || *read;
      if (*read) continue;
      absl::Status full = Append(" ");
      if (full.ok()) full = Append(word);
      if (!full.ok()) return full;
    }
    if (!*any) out_.resize(begin);
    return any;
  }

  // Writes a library as a data: URI, behind a space; nothing if it is there already. False if it cannot be read.
  absl::StatusOr<bool> Library(std::string_view text, const std::string& where) {
    if (text.size() > PATH_MAX) return false;
    const std::string name(text);
    const absl::StatusOr<std::optional<fs::path>> path = Find(name, outside_.wanted.any(), where);
    if (!path.ok()) return path.status();
    if (!*path) return false;
    if (libraries_.count(**path) != 0) return true;
    MemoryCharge charge(&MemoryOf(job_));
    const absl::StatusOr<std::optional<FileBytes>> bytes = Read(name, **path, charge);
    if (!bytes.ok()) return bytes.status();
    if (!*bytes) return false;
    libraries_.insert(**path);
    absl::Status bad = Append(absl::StrCat(" data:model/mtl;name=", Escape(name), ","));
    const fs::path folder = fs::path(WithSlashes(name)).parent_path();
    TextLines lines(TextOf(**bytes), job_);
    while (const std::optional<std::string_view> line = lines.Next()) {
      if (bad.ok()) bad = LibraryLine(*line, folder, absl::StrCat(name, ", line ", lines.number()));
      if (bad.ok()) bad = Append("%0A");
      if (!bad.ok()) return bad;
    }
    return true;
  }

  absl::Status LibraryLine(std::string_view line, const fs::path& folder, const std::string& where) {
    Words words(line, &job_);
    const std::string_view word = words.Next();
    const bool color = SameWord(word, "map_kd"), emissive = SameWord(word, "map_ke");
    if (!color && !emissive) return AppendEscaped(line);
    const bool wanted = color ? outside_.wanted.base_color : outside_.wanted.emissive;
    const std::string_view file = obj::ParseMapStatement(job_, words.Rest()).name;
    if (absl::Status full = AppendEscaped(line.substr(0, size_t(file.data() - line.data()))); !full.ok()) return full;
    const absl::StatusOr<bool> image = Image(file, folder, wanted, where);
    if (!image.ok()) return image.status();
    return *image ? absl::OkStatus() : AppendEscaped(line.substr(size_t(file.data() - line.data())));
  }

  // Writes what names a texture in the packed library: a data: URI at first, then its name there. False if it stays as
  // it is.
  absl::StatusOr<bool> Image(std::string_view text, const fs::path& folder, bool wanted, const std::string& where) {
    if (text.empty() || text.size() > PATH_MAX || IsDataUri(text)) return false;
    const std::string name(text), place = (folder / WithSlashes(name)).string();
    const absl::StatusOr<std::optional<fs::path>> path = Find(place, wanted, where);
    if (!path.ok()) return path.status();
    if (!*path) return false;
    const auto written = [](const absl::Status& status) -> absl::StatusOr<bool> {
      if (!status.ok()) return status;
      return true;
    };
    const auto known = images_.find(**path);
    if (known != images_.end()) return written(Append(Escape(known->second)));
    MemoryCharge charge(&MemoryOf(job_));
    const absl::StatusOr<std::optional<FileBytes>> bytes = Read(place, **path, charge);
    if (!bytes.ok()) return bytes.status();
    if (!*bytes) return false;
    // Another file of the same name, in another folder, must not take its place.
    const bool fresh = names_.insert(name).second;
    const std::string& shown =
        images_.emplace(**path, fresh ? name : absl::StrCat(name, "#", images_.size() + 1)).first->second;
    // The library is escaped as a whole, so what is escaped in it is escaped twice.
    absl::Status bad =
        Append(absl::StrCat("data:", MediaType(**path), Escape(absl::StrCat(";name=", Escape(shown), ";base64,"))));
    if (bad.ok()) {
      bad = AppendInSteps(TextOf(**bytes), [](std::string_view step) {
        return absl::Base64Escape({step.data(), step.size()});
      });
    }
    return written(bad);
  }

  static std::string WithSlashes(std::string name) {
    for (char& c : name) c = c == '\\' ? '/' : c;
    return name;
  }

  const JobContext& job_;
  const fs::path directory_;
  const LoadLimits& limits_;
  const OutsideFiles& outside_;
  MemoryCharge charge_;  // of all that this holds
  FileBytes out_;
  std::map<std::string, std::optional<fs::path>> paths_;  // by name
  std::set<fs::path> libraries_;                          // those written
  std::map<fs::path, std::string> images_;                // those written, and their names
  std::set<std::string> names_;                           // of images
};

}  // namespace

absl::StatusOr<std::optional<FileBytes>> PackObj(const JobContext& job, std::span<const uint8_t> bytes,
                                                 const fs::path& directory, const LoadLimits& limits,
                                                 const OutsideFiles& outside) {
  const std::string_view text = TextOf(bytes);
  if (!Contains(text, kLibraryWord, job)) {
    if (absl::Status over = job.Check(); !over.ok()) return over;
    return std::optional<FileBytes>();
  }
  return ObjPacker(job, directory, limits, outside).Pack(text);
}

}  // namespace voxelpipe
