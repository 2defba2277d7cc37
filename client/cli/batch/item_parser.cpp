#include "batch/item_parser.h"

#include <algorithm>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <span>
#include <string_view>
#include <type_traits>
#include <unordered_map>
#include <variant>

#include "absl/container/flat_hash_set.h"
#include "absl/hash/hash.h"
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
  return CheckHolds(extension, request.result, request.targets);
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
  if (open && format != nullptr && (format->of_whole_results() || format->labels)) canonical["format"] = format->name;
  if (options.clip) canonical["clip"] = *options.clip;
  if (options.parts != "whole") {
    canonical["parts"] = {options.parts, options.part_labels, options.part_priorities, options.exclude};
  }
  if (options.axes) canonical["axes"] = *options.axes;
  if (options.grid_like) canonical["grid_like"] = *options.grid_like;  // in no digest: those have its grid
  return canonical.dump(-1, ' ', true, json::error_handler_t::replace);
}

// Names, with the line of each. 16 bytes a name: a list may have millions.
class NameLines {
 public:
  // Out: the line of the name, which is `line` if no earlier one has it.
  size_t Add(std::string_view name, size_t line) {
    constexpr uint64_t kOther = 0x9e3779b97f4a7c15;  // any number: another hash of the same name
    const Entry entry{absl::HashOf(name), uint32_t(absl::HashOf(kOther, name)), uint32_t(line)};
    return entries_.insert(entry).first->line;
  }

 private:
  // The name by 96 bits of hashes: among a million names, two have the same with a probability of 1e-17.
  struct Entry {
    uint64_t high = 0;
    uint32_t low = 0, line = 0;
    template <typename H>
    friend H AbslHashValue(H state, const Entry& entry) {
      return H::combine(std::move(state), entry.high);
    }
    friend bool operator==(const Entry& a, const Entry& b) { return a.high == b.high && a.low == b.low; }
  };
  absl::flat_hash_set<Entry> entries_;
};

}  // namespace

class ItemParser::Impl {
 public:
  Impl(fs::path directory, const ManifestDefaults& defaults) : directory_(std::move(directory)), defaults_(defaults) {}

  absl::StatusOr<BatchItem> Parse(size_t line, std::string_view text) {
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
    return item;
  }

 private:
  absl::StatusOr<std::shared_ptr<const BatchRequest>> Prepare(const RequestOptions& options) {
    const std::string canonical = Canonical(options);
    // Fields outside the digest may still differ.
    const std::string key = absl::StrCat(canonical, options.backend, " ", options.simd, " ", options.threads);
    if (const auto known = requests_.find(key); known != requests_.end()) return known->second;
    const absl::StatusOr<RequestOptions> with_grid = WithGridLike(options, OptionNames::kKeys);
    if (!with_grid.ok()) return with_grid.status();
    absl::StatusOr<VoxelizeRequest> request = BuildRequest(*with_grid, OptionNames::kKeys);
    if (!request.ok()) return request.status();
    const std::string identity = Canonical(*with_grid);
    std::string digest = Sha256Hex({reinterpret_cast<const uint8_t*>(identity.data()), identity.size()});
    auto made = std::make_shared<const BatchRequest>(BatchRequest{*std::move(request), std::move(digest)});
    if (requests_.size() >= kMaxKeptRequests) requests_.clear();  // a list may have a request a line
    requests_.emplace(key, made);
    return made;
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
      if (const size_t line = ids_.Add(item.id, item.line); line != item.line) {
        return Wrong("the id '", item.id, "' is that of line ", line, " already");
      }
    }
    const size_t targets = item.request->request.targets.size();
    std::vector<std::string> files = WrittenPaths(item.output, targets);
    if (files.front() != item.output) files.push_back(item.output);  // names the record of the item
    if (!item.preview.empty()) files.push_back(item.preview);
    for (const std::string& file : files) {
      const size_t line = files_.Add(file, item.line);
      if (line == item.line && std::count(files.begin(), files.end(), file) == 1) continue;
      return Wrong("the output '", file, "' is that of line ", line, " already; give an 'id' or an 'output'");
    }
    return absl::OkStatus();
  }

  static constexpr size_t kMaxKeptRequests = 1024;

  const fs::path directory_;
  const ManifestDefaults& defaults_;
  std::unordered_map<std::string, std::shared_ptr<const BatchRequest>> requests_;
  NameLines ids_, files_;
};

ItemParser::ItemParser(const std::string& directory, const ManifestDefaults& defaults)
    : impl_(std::make_unique<Impl>(directory, defaults)) {}
ItemParser::~ItemParser() = default;

absl::StatusOr<BatchItem> ItemParser::Parse(size_t line, std::string_view text) {
  return impl_->Parse(line, text);
}

}  // namespace voxelpipe::cli
