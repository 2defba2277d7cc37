#include "options/together.h"

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <unordered_map>
#include <utility>

#include "absl/strings/str_cat.h"
#include "encode/encode.h"
#include "load/local_file.h"
#include "options/standard_streams.h"

namespace voxelpipe::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr uint64_t kMaxListBytes = uint64_t{64} << 20;
constexpr size_t kNamesShown = 3;

template <typename... Parts>
absl::Status Wrong(const Parts&... parts) {
  return absl::InvalidArgumentError(absl::StrCat(parts...));
}

absl::Status CheckCount(size_t count) {
  if (count == 0) return Wrong("meshes: at least one is expected");
  if (count > kMaxPlacedMeshes)
    return Wrong("meshes: ", count, " of them; at most ", kMaxPlacedMeshes, " fit on one grid");
  return absl::OkStatus();
}

// Lists files once each.
class Files {
 public:
  explicit Files(std::vector<std::string>& paths) : paths_(paths) {}
  size_t IndexOf(const std::string& path) {
    const auto [known, fresh] = index_.try_emplace(path, paths_.size());
    if (fresh) paths_.push_back(path);
    return known->second;
  }

 private:
  std::vector<std::string>& paths_;
  std::unordered_map<std::string, size_t> index_;
};

std::string FileNameOf(const std::string& path) {
  return IsStandardStream(path) ? path : fs::path(path).filename().string();
}

absl::Status ReadNumbers(const json& list, size_t count, double* out) {
  if (!list.is_array() || list.size() != count) return Wrong(count, " numbers are expected");
  for (const json& number : list) {
    if (!number.is_number()) return Wrong(count, " numbers are expected");
    *out++ = number.get<double>();
  }
  return absl::OkStatus();
}

absl::Status ReadMatrix(const json& value, Mat4d& matrix) {
  constexpr char kForm[] = "16 numbers, row by row, or 4 lists of 4 are expected";
  if (!value.is_array()) return Wrong(kForm);
  if (value.size() == 4) {
    for (size_t r = 0; r < 4; ++r) {
      if (!ReadNumbers(value[r], 4, matrix.m[r]).ok()) return Wrong(kForm);
    }
  } else if (!ReadNumbers(value, 16, matrix.m[0]).ok()) {
    return Wrong(kForm);
  }
  return CheckPlacement(matrix);
}

absl::Status ReadMotion(const json& value, RigidMotionNumbers& motion) {
  if (!value.is_object()) return Wrong("an object with linear, angular and center is expected");
  for (const auto& [key, numbers] : value.items()) {
    Vec3d* const to = key == "linear"    ? &motion.linear
                      : key == "angular" ? &motion.angular
                      : key == "center"  ? &motion.center
                                         : nullptr;
    if (to == nullptr) return Wrong("unknown key '", key, "'; known are linear, angular and center");
    double three[3];
    if (absl::Status s = ReadNumbers(numbers, 3, three); !s.ok()) return Wrong(key, ": ", std::string(s.message()));
    for (int i = 0; i < 3; ++i) {
      if (!std::isfinite(three[i])) return Wrong(key, ": finite numbers are expected");
      (*to)[i] = three[i];
    }
  }
  return absl::OkStatus();
}

absl::Status ReadWhole(const json& value, int64_t min, int64_t max, int64_t& out) {
  const bool fits = value.is_number_integer() &&
                    !(value.is_number_unsigned() && value.get<uint64_t>() > uint64_t(max)) &&
                    value.get<int64_t>() >= min && value.get<int64_t>() <= max;
  if (!fits) return Wrong("a whole number from ", min, " to ", max, " is expected");
  out = value.get<int64_t>();
  return absl::OkStatus();
}

absl::Status ReadKey(const std::string& key, const json& value, const std::string& directory, Files& files,
                     PlacedInput& input) {
  PlacedMesh& placement = input.placement;
  int64_t number = 0;
  if (key == "input" || key == "name") {
    if (!value.is_string() || value.get<std::string>().empty()) return Wrong("a text is expected");
    const auto text = value.get<std::string>();
    if (text.find('\0') != std::string::npos) return Wrong("holds a zero byte");
    if (key == "name") {
      placement.name = text;
      return absl::OkStatus();
    }
    if (IsStandardStream(text)) return Wrong("'-' is standard input; name a file (./- has this name)");
    input.file = files.IndexOf(FindBeside(directory, text));
    return absl::OkStatus();
  }
  if (key == "matrix") return ReadMatrix(value, placement.matrix);
  if (key == "motion") return ReadMotion(value, placement.motion.emplace());
  if (key == "label") {
    absl::Status s = ReadWhole(value, 1, UINT32_MAX, number);
    if (s.ok()) placement.label = uint32_t(number);
    return s;
  }
  if (key == "priority") {
    absl::Status s = ReadWhole(value, INT32_MIN, INT32_MAX, number);
    placement.priority = int32_t(number);
    return s;
  }
  return Wrong("unknown key; known are input, matrix, name, label, priority and motion");
}

}  // namespace

std::vector<std::string> WithTogetherValue(std::vector<std::string> arguments) {
  for (size_t i = 0; i < arguments.size() && arguments[i] != "--"; ++i) {
    if (arguments[i] != "--together") continue;
    // An empty value comes from an unset variable of a script, and is refused as one.
    const bool last = i + 1 == arguments.size();
    if (!last && (arguments[i + 1].empty() || FileExtension(arguments[i + 1]) == ".json")) continue;
    absl::StrAppend(&arguments[i], "=", kTogetherInputs);
  }
  return arguments;
}

std::string FindBeside(const std::string& directory, const std::string& input) {
  const fs::path path(input);
  if (path.is_absolute()) return input;
  std::error_code ignored;
  const fs::path beside = fs::path(directory) / path;
  return fs::exists(beside, ignored) || !fs::exists(path, ignored) ? beside.string() : input;
}

absl::StatusOr<Together> TogetherOf(const std::vector<std::string>& paths) {
  if (absl::Status s = CheckCount(paths.size()); !s.ok()) return s;
  Together together;
  Files files(together.paths);
  for (const std::string& path : paths) {
    PlacedInput input;
    input.file = files.IndexOf(path);
    input.placement.name = FileNameOf(path);
    together.placed.push_back(std::move(input));
  }
  return together;
}

absl::StatusOr<Together> ParseTogether(const json& meshes, const std::string& directory) {
  if (!meshes.is_array()) return Wrong("meshes: a list is expected");
  if (absl::Status s = CheckCount(meshes.size()); !s.ok()) return s;
  Together together;
  Files files(together.paths);
  for (size_t i = 0; i < meshes.size(); ++i) {
    if (!meshes[i].is_object() || !meshes[i].contains("input")) {
      return Wrong("meshes[", i, "]: an object with an input is expected");
    }
    PlacedInput input;
    for (const auto& [key, value] : meshes[i].items()) {
      if (absl::Status s = ReadKey(key, value, directory, files, input); !s.ok()) {
        return Wrong("meshes[", i, "].", key, ": ", std::string(s.message()));
      }
    }
    if (input.placement.name.empty()) input.placement.name = FileNameOf(together.paths[input.file]);
    together.placed.push_back(std::move(input));
  }
  return together;
}

absl::StatusOr<Together> ReadTogether(const std::string& path) {
  const absl::StatusOr<FileBytes> bytes = ReadLocalFile(path, kMaxListBytes);
  if (!bytes.ok())
    return absl::Status(bytes.status().code(), absl::StrCat(path, ": ", std::string(bytes.status().message())));
  const std::span<const uint8_t> text = *bytes;
  json list;
  try {
    list = json::parse(text.begin(), text.end());
  } catch (const json::exception& error) {
    return Wrong(path, ": no JSON: ", error.what());
  }
  if (!list.is_object() || !list.contains("meshes") || list.size() != 1) {
    return Wrong(path, ": an object {\"meshes\": [...]} is expected");
  }
  absl::StatusOr<Together> together = ParseTogether(list["meshes"], fs::path(path).parent_path().string());
  if (!together.ok()) return Wrong(path, ": ", std::string(together.status().message()));
  return together;
}

std::string PlacingText(const std::vector<PlacedInput>& placed) {
  json list = json::array();
  const auto add = [](json& numbers, const Vec3d& v) {
    for (int i = 0; i < 3; ++i) numbers.push_back(v[i] + 0.0);  // -0 is 0
  };
  for (const PlacedInput& input : placed) {
    const PlacedMesh& placement = input.placement;
    json numbers = json::array();
    for (const auto& row : placement.matrix.m) {
      for (const double number : row) numbers.push_back(number + 0.0);
    }
    if (placement.motion) {
      for (const Vec3d& v : {placement.motion->linear, placement.motion->angular, placement.motion->center}) {
        add(numbers, v);
      }
    }
    list.push_back({input.file, placement.name, placement.label.value_or(0), placement.priority, numbers});
  }
  return list.dump(-1, ' ', true, json::error_handler_t::replace);
}

std::string NameOf(const Together& together) {
  std::string name;
  const size_t count = together.placed.size();
  for (size_t i = 0; i < std::min(count, kNamesShown); ++i) {
    absl::StrAppend(&name, i == 0 ? "" : " + ", together.paths[together.placed[i].file]);
  }
  if (count > kNamesShown) absl::StrAppend(&name, " + ", count - kNamesShown, " more");
  return name;
}

}  // namespace voxelpipe::cli
