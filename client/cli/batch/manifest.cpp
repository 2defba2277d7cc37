#include "batch/manifest.h"

#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <string_view>
#include <type_traits>
#include <unordered_map>
#include <variant>

#include "absl/strings/str_cat.h"
#include "batch/done_record.h"
#include "encode/encode.h"
#include "encode/format_registry.h"
#include "engine/hash.h"
#include "options/standard_streams.h"
#include "options/together.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr size_t kMaxLineBytes = size_t{1} << 20;

template <typename... Parts>
absl::Status Wrong(const Parts&... parts) {
  return absl::InvalidArgumentError(absl::StrCat(parts...));
}

// A number, a text, or a list of numbers, in command-line form.
absl::StatusOr<std::string> AsText(const std::string& key, const json& value) {
  if (value.is_string()) return value.get<std::string>();
  if (value.is_number()) return value.dump();
  if (value.is_array() && !value.empty()) {
    std::string text;
    for (const json& part : value) {
      if (!part.is_number()) return Wrong("'", key, "': a list of numbers is expected");
      absl::StrAppend(&text, text.empty() ? "" : ",", part.dump());
    }
    return text;
  }
  return Wrong("'", key, "': a text or a number is expected");
}

absl::StatusOr<int64_t> AsWhole(const std::string& key, const json& value) {
  if (value.is_number_unsigned() && value.get<uint64_t>() > uint64_t(INT64_MAX))
    return Wrong("'", key, "' is too large");
  if (value.is_number_integer()) return value.get<int64_t>();
  return Wrong("'", key, "': a whole number is expected");
}

absl::StatusOr<std::vector<std::string>> AsTexts(const std::string& key, const json& value) {
  std::vector<std::string> texts;
  if (value.is_string()) return std::vector<std::string>{value.get<std::string>()};
  for (const json& part : value) {
    if (!value.is_array() || !part.is_string()) return Wrong("'", key, "': a text or a list of texts is expected");
    texts.push_back(part.get<std::string>());
  }
  if (texts.empty()) return Wrong("'", key, "': a text or a list of texts is expected");
  return texts;
}

// The fields of an item besides its request.
struct ItemNames {
  std::optional<std::string> id{}, input{}, output{}, format{}, preview{}, view{}, unit{}, input_format{};
};

// Sets one option of the request, which must not be one of those that are set `already`; false if there is none of this
// name. A list also has its plural as a key.
absl::StatusOr<bool> SetOption(const std::string& key, const json& value, RequestOptions& options,
                               std::set<std::string_view>& already) {
  const std::span<const RequestOption> list = ListRequestOptions();
  const auto has_key = [&](const RequestOption& option) {
    return key == option.name || (std::holds_alternative<std::vector<std::string> RequestOptions::*>(option.value) &&
                                  key == absl::StrCat(std::string(option.name), "s"));
  };
  const auto found = std::find_if(list.begin(), list.end(), has_key);
  if (found == list.end()) return false;
  if (!already.insert(found->name).second) return Wrong("'", std::string(found->name), "' is given twice");
  const auto set = [&](auto field) -> absl::Status {
    auto& out = options.*field;
    const auto take = [&out](auto read) {
      if (read.ok()) out = *std::move(read);
      return read.status();
    };
    using Field = std::remove_reference_t<decltype(out)>;
    if constexpr (std::is_same_v<Field, bool>) {
      if (!value.is_boolean()) return Wrong("'", key, "': true or false is expected");
      out = value.get<bool>();
      return absl::OkStatus();
    } else if constexpr (std::is_same_v<Field, std::vector<std::string>>) {
      return take(AsTexts(key, value));
    } else if constexpr (std::is_same_v<Field, int>) {
      const absl::StatusOr<int64_t> number = AsWhole(key, value);
      if (number.ok() && (*number < 0 || *number > INT32_MAX)) return Wrong("'", key, "' is out of range");
      if (number.ok()) out = int(*number);
      return number.status();
    } else if constexpr (std::is_same_v<Field, int64_t> || std::is_same_v<Field, std::optional<int64_t>>) {
      return take(AsWhole(key, value));
    } else {
      return take(AsText(key, value));
    }
  };
  if (absl::Status s = std::visit(set, found->value); !s.ok()) return s;
  return true;
}

absl::Status SetName(const std::string& key, const json& value, ItemNames& names) {
  const std::map<std::string, std::optional<std::string>*> known = {
      {"id", &names.id},         {"name", &names.id},       {"input", &names.input},
      {"output", &names.output}, {"format", &names.format}, {"preview", &names.preview},
      {"view", &names.view},     {"unit", &names.unit},     {"input_format", &names.input_format}};
  const auto found = known.find(key);
  if (found == known.end()) return Wrong("unknown key '", key, "'");
  if (!value.is_string() && !(found->second == &names.id && value.is_number_integer())) {
    return Wrong("'", key, "': a text is expected");
  }
  if (found->second->has_value()) return Wrong("'id' and 'name' mean the same; give one of them");
  *found->second = value.is_string() ? value.get<std::string>() : value.dump();
  if ((*found->second)->empty()) return Wrong("'", key, "' must not be empty");
  if ((*found->second)->find('\0') != std::string::npos) return Wrong("'", key, "' holds a zero byte");
  return absl::OkStatus();
}

// A request gives the grid in one of several forms; the form of an item replaces that of the defaults.
void DropOtherGrids(const json& object, RequestOptions& options) {
  const auto gives = [&](const char* key, const char* typed) { return object.contains(key) || object.contains(typed); };
  if (gives("grid_like", "grid-like")) {
    for (auto* other : {&options.voxel_size, &options.dims, &options.origin, &options.fit, &options.clip}) {
      other->reset();
    }
    options.resolution.reset();
    return;
  }
  if (gives("resolution", "resolution") || gives("voxel_size", "voxel-size")) options.grid_like.reset();
  if (gives("clip", "clip")) {
    for (auto* other : {&options.dims, &options.origin, &options.grid_like}) other->reset();
  } else if (gives("dims", "dims")) {
    options.clip.reset();
  }
  if (gives("resolution", "resolution")) {
    options.voxel_size.reset();
    options.dims.reset();
    options.origin.reset();
  } else if (gives("voxel_size", "voxel-size")) {
    options.resolution.reset();
    options.fit.reset();
    if (!gives("origin", "origin") && !options.origin) options.dims.reset();
  } else if (gives("dims", "dims")) {
    options.resolution.reset();
    options.fit.reset();
  }
}

// "a/b.npy" below the output directory, cleaned of "./" and "//".
absl::StatusOr<std::string> InsideOutput(const char* key, const std::string& text) {
  const fs::path path(text);
  const fs::path clean = path.lexically_normal();
  const bool leaves =
      path.is_absolute() || clean.empty() || clean == "." || *clean.begin() == ".." || !clean.has_filename();
  if (leaves) return Wrong("'", key, "': '", text, "' is not a file below the output directory");
  if (*clean.begin() == kRecordDirectory) return Wrong("'", key, "': ", kRecordDirectory, " is the batch's own");
  return clean.string();
}

absl::Status CheckFormat(const std::string& extension, const VoxelizeRequest& request) {
  if (!IsKnownExtension(extension)) {
    const std::string why(WhyNotBuilt(extension));
    return Wrong(extension.empty() ? "no format" : absl::StrCat("'", extension, "' is no known format"),
                 why.empty() ? "" : ": ", why, "; known are ", ListFormats(false));
  }
  return CheckHolds(extension, request.result, request.targets.size());
}

// The canonical text of a request: its options in a fixed order. Equal texts are equal requests; equal requests may
// have different texts.
std::string Canonical(const RequestOptions& options) {
  const auto text = [](const auto& value) { return value ? json(*value) : json(nullptr); };
  json canonical{{"resolution", text(options.resolution)},
                 {"voxel_size", text(options.voxel_size)},
                 {"dims", text(options.dims)},
                 {"origin", text(options.origin)},
                 {"fit", text(options.fit)},
                 {"padding", options.padding},
                 {"coverage", options.coverage},
                 {"fill", options.fill},
                 {"shader", text(options.shader)},
                 {"vertex_shader", text(options.vertex_shader)},
                 {"targets", options.targets},
                 {"layout", options.layout},
                 {"result", options.result.value_or("dense")}};
  // Only if set, so that earlier records stay valid.
  if (options.strict) canonical["strict"] = true;
  const OutputFormat* const format = FindFormat(options.output_extension);
  const bool open = !options.result || (options.targets.empty() && !options.shader);
  if (open && format != nullptr && format->of_whole_results()) canonical["format"] = format->name;
  if (options.clip) canonical["clip"] = *options.clip;
  if (options.parts != "whole") {
    canonical["parts"] = {options.parts, options.part_labels, options.part_priorities, options.exclude};
  }
  if (options.axes) canonical["axes"] = *options.axes;
  if (options.grid_like) canonical["grid_like"] = *options.grid_like;  // in no digest: those have its grid
  return canonical.dump(-1, ' ', true, json::error_handler_t::replace);
}

class Reader {
 public:
  Reader(fs::path directory, const ManifestDefaults& defaults)
      : directory_(std::move(directory)), defaults_(defaults) {}

  absl::Status Add(size_t line, const std::string& text) {
    json object;
    try {
      object = json::parse(text);
    } catch (const json::exception& error) {
      return Wrong("no JSON: ", error.what());
    }
    if (!object.is_object()) return Wrong("a JSON object is expected");
    ItemNames names;
    RequestOptions options = defaults_.request;
    DropOtherGrids(object, options);
    std::set<std::string_view> set;
    for (const auto& [typed, value] : object.items()) {
      std::string key = typed;
      std::replace(key.begin(), key.end(), '-', '_');
      if (key == "meshes") continue;
      const absl::StatusOr<bool> is_option = SetOption(key, value, options, set);
      if (!is_option.ok()) return is_option.status();
      if (*is_option) continue;
      if (absl::Status s = SetName(key, value, names); !s.ok()) return s;
    }
    if (object.contains("grid_like") || object.contains("grid-like")) {
      options.grid_like = FindBeside(directory_.string(), *options.grid_like);
    }
    Together meshes;
    if (const auto several = object.find("meshes"); several != object.end()) {
      if (names.input) return Wrong("'input' and 'meshes' exclude each other");
      absl::StatusOr<Together> together = ParseTogether(*several, directory_.string());
      if (!together.ok()) return together.status();
      meshes = *std::move(together);
      names.input = meshes.paths[0];
    }
    if (!names.input) return Wrong("'input' is missing");
    if (IsStandardStream(*names.input)) return Wrong("'input': '-' is standard input; name a file (./- has this name)");
    const std::string format = names.format.value_or(defaults_.format.value_or(""));
    const std::string of_name = names.output ? FileExtension(*names.output) : "";
    options.output_extension = of_name.empty() ? FileExtension("x." + format) : of_name;
    absl::StatusOr<std::shared_ptr<const BatchRequest>> request = Prepare(options);
    if (!request.ok()) return request.status();
    BatchItem item;
    item.line = line;
    item.request = *std::move(request);
    item.input = meshes.paths.empty() ? FindBeside(directory_.string(), *names.input) : meshes.paths[0];
    item.meshes = std::move(meshes);
    const absl::StatusOr<MeshFileType> type =
        MeshTypeOf(names.input_format.value_or(defaults_.mesh.input_format), names.unit.value_or(defaults_.mesh.unit));
    if (!type.ok()) return type.status();
    item.type = *type;
    if (absl::Status s = NameOutput(names, item); !s.ok()) return s;
    if (names.preview) {
      absl::StatusOr<std::string> preview = InsideOutput("preview", *names.preview);
      if (!preview.ok()) return preview.status();
      if (FileExtension(*preview) != ".png")
        return Wrong("'preview': '", *names.preview, "': the extension must be .png");
      item.preview = *std::move(preview);
    }
    if (absl::Status s = ChooseView(names, item); !s.ok()) return s;
    if (absl::Status s = Claim(item, names.id.has_value()); !s.ok()) return s;
    items_.push_back(std::move(item));
    return absl::OkStatus();
  }

  std::vector<BatchItem> Take() { return std::move(items_); }

 private:
  absl::StatusOr<std::shared_ptr<const BatchRequest>> Prepare(const RequestOptions& options) {
    const std::string canonical = Canonical(options);
    // Fields outside the digest may still differ.
    const std::string key = absl::StrCat(canonical, options.backend, " ", options.simd, " ", options.threads);
    std::shared_ptr<const BatchRequest>& known = requests_[key];
    if (known != nullptr) return known;
    const absl::StatusOr<RequestOptions> with_grid = WithGridLike(options, OptionNames::kKeys);
    if (!with_grid.ok()) return with_grid.status();
    absl::StatusOr<VoxelizeRequest> request = BuildRequest(*with_grid, OptionNames::kKeys);
    if (!request.ok()) return request.status();
    const std::string identity = Canonical(*with_grid);
    std::string digest = Sha256Hex({reinterpret_cast<const uint8_t*>(identity.data()), identity.size()});
    known = std::make_shared<const BatchRequest>(BatchRequest{*std::move(request), std::move(digest)});
    return known;
  }

  absl::Status NameOutput(const ItemNames& names, BatchItem& item) const {
    const ResultKind kind = item.request->request.result;
    const std::string usual = kind == ResultKind::kDense ? "npy" : "npz";
    std::string format = names.format.value_or(defaults_.format.value_or(usual));
    if (format.front() == '.') format.erase(0, 1);
    std::string name;
    if (names.output) {
      name = *names.output;
      if (FileExtension(name).empty()) absl::StrAppend(&name, ".", format);
      if (names.format && FileExtension(name) != FileExtension("x." + format)) {
        return Wrong("'output' and 'format' differ: '", name, "' is no ", format);
      }
    } else {
      name = absl::StrCat(names.id ? *names.id : fs::path(item.input).stem().string(), ".", format);
    }
    const char* const key = names.output ? "output" : names.id ? "id" : "input";
    absl::StatusOr<std::string> output = InsideOutput(key, name);
    if (!output.ok()) return output.status();
    if (absl::Status s = CheckFormat(FileExtension(*output), item.request->request); !s.ok())
      return Wrong("'", key, "': ", std::string(s.message()));
    item.output = *std::move(output);
    item.id = names.id ? *names.id : item.output.substr(0, item.output.size() - FileExtension(item.output).size());
    return absl::OkStatus();
  }

  absl::Status ChooseView(const ItemNames& names, BatchItem& item) const {
    const bool picture = !item.preview.empty() || FileExtension(item.output) == ".png";
    if (names.view && !picture) return Wrong("'view': there is no picture; give a 'preview'");
    const std::optional<std::string>& text = names.view ? names.view : defaults_.view;
    if (!text || !picture) return absl::OkStatus();
    const absl::StatusOr<PreviewView> view = ParseView(*text);
    if (!view.ok()) return Wrong("'view': ", std::string(view.status().message()));
    item.view = *view;
    return absl::OkStatus();
  }

  // Every file and every given id belongs to one item.
  absl::Status Claim(const BatchItem& item, bool has_id) {
    if (has_id) {
      const auto [at, fresh] = ids_.emplace(item.id, item.line);
      if (!fresh) return Wrong("the id '", item.id, "' is that of line ", at->second, " already");
    }
    const size_t targets = item.request->request.targets.size();
    std::vector<std::string> files = WrittenPaths(item.output, targets);
    if (files.front() != item.output) files.push_back(item.output);  // names the record of the item
    if (!item.preview.empty()) files.push_back(item.preview);
    for (const std::string& file : files) {
      const auto [at, fresh] = files_.emplace(file, item.line);
      if (fresh) continue;
      return Wrong("the output '", file, "' is that of line ", at->second, " already; give an 'id' or an 'output'");
    }
    return absl::OkStatus();
  }

  const fs::path directory_;
  const ManifestDefaults& defaults_;
  std::vector<BatchItem> items_;
  std::unordered_map<std::string, std::shared_ptr<const BatchRequest>> requests_;
  std::unordered_map<std::string, size_t> ids_, files_;  // line numbers
};

}  // namespace

absl::StatusOr<Shard> ParseShard(const std::string& text) {
  Shard shard;
  const char* const end = text.data() + text.size();
  const auto [slash, first] = std::from_chars(text.data(), end, shard.index);
  const bool has_slash = first == std::errc() && slash != end && *slash == '/';
  if (has_slash) {
    const auto [stop, second] = std::from_chars(slash + 1, end, shard.count);
    if (second == std::errc() && stop == end && shard.count >= 1 && shard.index <= shard.count) return shard;
  }
  return Wrong("--shard: '", text, "' is not of the form i/n with i from 0 to n");
}

absl::StatusOr<Manifest> ReadManifest(const std::string& path, const ManifestDefaults& defaults) {
  std::error_code error;
  if (!fs::exists(path, error)) return absl::NotFoundError(absl::StrCat(path, ": no such file"));
  if (fs::is_directory(path, error)) return Wrong(path, ": is a directory");
  errno = 0;
  std::ifstream file(path, std::ios::binary);
  if (!file) return Wrong(path, ": cannot be read: ", std::strerror(errno));
  Reader reader(fs::path(path).parent_path(), defaults);
  std::string text;
  for (size_t line = 1; std::getline(file, text); ++line) {
    if (line == 1 && text.starts_with("\xEF\xBB\xBF")) text.erase(0, 3);  // a byte order mark of some editors
    if (text.find_first_not_of(" \t\r") == std::string::npos) continue;
    absl::Status status =
        text.size() > kMaxLineBytes ? Wrong("longer than ", kMaxLineBytes, " bytes") : reader.Add(line, text);
    if (!status.ok()) return Wrong(path, ":", line, ": ", std::string(status.message()));
  }
  if (file.bad()) return absl::DataLossError(absl::StrCat(path, ": cannot be read completely"));
  return Manifest{reader.Take()};
}

}  // namespace voxelpipe::cli
