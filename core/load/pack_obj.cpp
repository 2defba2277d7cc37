#include "load/pack_obj.h"

#include <cstring>
#include <map>
#include <string>
#include <string_view>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
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

class ObjPacker {
 public:
  ObjPacker(fs::path directory, const LoadLimits& limits, const OutsideFiles& outside)
      : directory_(std::move(directory)), limits_(limits), outside_(outside) {}

  absl::StatusOr<std::optional<FileBytes>> Pack(std::string_view text) {
    std::string out;
    size_t copied = 0;  // bytes of the text
    TextLines lines(text);
    while (const std::optional<std::string_view> line = lines.Next()) {
      Words words(*line);
      if (words.Next() != kLibraryWord || words.Rest().empty()) continue;
      const std::string where = absl::StrCat("line ", lines.number());
      const absl::StatusOr<std::string> statements = Libraries(words.Rest(), where);
      if (!statements.ok()) return statements.status();
      if (statements->empty()) continue;
      const auto at = size_t(line->data() - text.data());
      if (absl::Status full = CheckSize(out.size() + text.size() + statements->size()); !full.ok()) return full;
      out.append(text.substr(copied, at - copied));
      out += *statements;
      copied = at + line->size();
    }
    if (copied == 0) return std::optional<FileBytes>();
    out.append(text.substr(copied));
    return std::optional<FileBytes>(FileBytes(out.begin(), out.end()));
  }

 private:
  absl::Status CheckSize(uint64_t bytes) const {
    if (bytes <= limits_.max_file_bytes) return absl::OkStatus();
    return absl::ResourceExhaustedError(
        absl::StrCat("the packed mesh would be larger than ", limits_.max_file_bytes, " bytes"));
  }

  // The bytes of a file; empty if there is none. Errors: those of files outside, if `wanted`.
  absl::StatusOr<std::optional<FileBytes>> Read(const std::string& name, bool wanted, const std::string& where,
                                                fs::path& path) const {
    const absl::StatusOr<SiblingFile> sibling = ResolveSiblingName(directory_, name);
    if (!sibling.ok()) return std::optional<FileBytes>();
    if (!sibling->outside.empty() && !outside_.allowed) {
      std::error_code ignored;
      if (!wanted || !fs::exists(sibling->path, ignored)) return std::optional<FileBytes>();
      return absl::InvalidArgumentError(absl::StrCat(where, ": the file ", Quote(name), " ", sibling->outside,
                                                     ", and is read only where that is allowed (--allow-outside)"));
    }
    absl::StatusOr<FileBytes> bytes = ReadLocalFile(sibling->path, limits_.max_file_bytes);
    if (!bytes.ok()) return std::optional<FileBytes>();
    path = sibling->path;
    return std::optional<FileBytes>(*std::move(bytes));
  }

  // The statement for the libraries of a line: one name, which may hold spaces, or several. Empty: nothing to change.
  absl::StatusOr<std::string> Libraries(std::string_view names, const std::string& where) {
    if (IsDataUri(names)) return std::string();
    absl::StatusOr<std::string> whole = Library(std::string(names), where);
    if (!whole.ok()) return whole.status();
    if (!whole->empty()) return absl::StrCat("mtllib ", *whole);
    std::string statement = "mtllib";
    bool any = false;
    Words words(names);
    for (std::string_view word = words.Next(); !word.empty(); word = words.Next()) {
      absl::StatusOr<std::string> uri = Library(std::string(word), where);
      if (!uri.ok()) return uri.status();
      any = any || !uri->empty();
      absl::StrAppend(&statement, " ", uri->empty() ? std::string(word) : *uri);
    }
    return any ? statement : std::string();
  }

  // The data: URI of a library; empty if it cannot be read.
  absl::StatusOr<std::string> Library(const std::string& name, const std::string& where) {
    fs::path path;
    const absl::StatusOr<std::optional<FileBytes>> bytes = Read(name, outside_.wanted.any(), where, path);
    if (!bytes.ok()) return bytes.status();
    if (!*bytes) return std::string();
    std::string uri = absl::StrCat("data:model/mtl;name=", Escape(name), ",");
    const fs::path folder = fs::path(WithSlashes(name)).parent_path();
    TextLines lines(TextOf(**bytes));
    while (const std::optional<std::string_view> line = lines.Next()) {
      Words words(*line);
      const std::string_view word = words.Next();
      const bool color = SameWord(word, "map_kd"), emissive = SameWord(word, "map_ke");
      std::string_view rest = *line;
      std::string map;
      if (color || emissive) {
        const bool wanted = color ? outside_.wanted.base_color : outside_.wanted.emissive;
        const std::string_view file = obj::ParseMapStatement(words.Rest()).name;
        absl::StatusOr<std::string> image =
            Image(std::string(file), folder, wanted, absl::StrCat(name, ", line ", lines.number()));
        if (!image.ok()) return image.status();
        if (!image->empty()) {
          map = *std::move(image);
          rest = line->substr(0, size_t(file.data() - line->data()));
        }
      }
      absl::StrAppend(&uri, Escape(rest), map, "%0A");
      if (absl::Status full = CheckSize(uri.size()); !full.ok()) return full;
    }
    return uri;
  }

  // What names a texture in the packed library: a data: URI at first, then its name there. Empty: it stays as it is.
  absl::StatusOr<std::string> Image(const std::string& name, const fs::path& folder, bool wanted,
                                    const std::string& where) {
    if (name.empty() || IsDataUri(name)) return std::string();
    fs::path path;
    const absl::StatusOr<std::optional<FileBytes>> bytes =
        Read((folder / WithSlashes(name)).string(), wanted, where, path);
    if (!bytes.ok()) return bytes.status();
    if (!*bytes) return std::string();
    const auto [known, fresh] = images_.emplace(path, name);
    if (!fresh) return Escape(known->second);
    // Another file of the same name, in another folder, must not take its place.
    if (!names_.insert({name, path}).second) known->second = absl::StrCat(name, "#", images_.size());
    if (absl::Status full = CheckSize((*bytes)->size() / 3 * 4); !full.ok()) return full;
    const std::string_view content = TextOf(**bytes);
    // The library is escaped as a whole, so what is escaped in it is escaped twice.
    return absl::StrCat("data:", MediaType(path), Escape(absl::StrCat(";name=", Escape(known->second), ";base64,")),
                        absl::Base64Escape({content.data(), content.size()}));
  }

  static std::string WithSlashes(std::string name) {
    for (char& c : name) c = c == '\\' ? '/' : c;
    return name;
  }

  const fs::path directory_;
  const LoadLimits& limits_;
  const OutsideFiles& outside_;
  std::map<fs::path, std::string> images_;  // those written, and their names
  std::map<std::string, fs::path> names_;
};

}  // namespace

absl::StatusOr<std::optional<FileBytes>> PackObj(std::span<const uint8_t> bytes, const fs::path& directory,
                                                 const LoadLimits& limits, const OutsideFiles& outside) {
  const std::string_view text = TextOf(bytes);
  if (memmem(text.data(), text.size(), kLibraryWord.data(), kLibraryWord.size()) == nullptr) {
    return std::optional<FileBytes>();
  }
  return ObjPacker(directory, limits, outside).Pack(text);
}

}  // namespace voxelpipe
