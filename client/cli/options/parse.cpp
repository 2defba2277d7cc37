#include "options/parse.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "shaders/catalog.h"

namespace voxelpipe::cli {
namespace {

// This Abseil is built without std::string_view: its functions take std::string.
std::string Quoted(std::string_view text) {
  return absl::StrCat("'", std::string(text), "'");
}

std::vector<std::string_view> Split(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  while (true) {
    const size_t at = text.find(separator);
    parts.push_back(text.substr(0, at));
    if (at == std::string_view::npos) return parts;
    text.remove_prefix(at + 1);
  }
}

absl::StatusOr<double> ParseNumber(std::string_view text) {
  double value = 0;
  if (!absl::SimpleAtod(std::string(text), &value) || std::isnan(value)) {
    return absl::InvalidArgumentError(absl::StrCat(Quoted(text), " is not a number"));
  }
  return value;
}

absl::StatusOr<Vec3d> ParseVec3(std::string_view text, bool one_for_all) {
  absl::StatusOr<std::vector<double>> numbers = ParseNumbers(text, ',');
  if (!numbers.ok()) return numbers.status();
  if (one_for_all && numbers->size() == 1) numbers->resize(3, numbers->front());
  if (numbers->size() != 3) {
    return absl::InvalidArgumentError(absl::StrCat(Quoted(text), " has ", numbers->size(), " numbers; ",
                                                   one_for_all ? "one or three" : "three", " expected"));
  }
  for (const double number : *numbers) {
    if (!std::isfinite(number)) return absl::InvalidArgumentError(absl::StrCat(Quoted(text), " is not finite"));
  }
  return Vec3d{(*numbers)[0], (*numbers)[1], (*numbers)[2]};
}

struct KeyValue {
  std::string key;
  std::string_view value;
};

// "k=v,k=v"
absl::StatusOr<std::vector<KeyValue>> ParseKeyValues(std::string_view text) {
  std::vector<KeyValue> pairs;
  for (const std::string_view part : Split(text, ',')) {
    const size_t equals = part.find('=');
    if (equals == std::string_view::npos || equals == 0 || equals + 1 == part.size()) {
      return absl::InvalidArgumentError(absl::StrCat(Quoted(part), " is not of the form name=value"));
    }
    const std::string key(part.substr(0, equals));
    for (const KeyValue& other : pairs) {
      if (other.key == key) return absl::InvalidArgumentError(absl::StrCat(Quoted(key), " is given twice"));
    }
    pairs.push_back({key, part.substr(equals + 1)});
  }
  return pairs;
}

// True if a shader has a text parameter of this name, whose value is not parsed as numbers.
bool IsTextParameter(const std::string& name) {
  for (const ShaderInfo& shader : ListShaders()) {
    for (const ShaderParameterInfo& parameter : shader.parameters) {
      if (parameter.type == "string" && parameter.name == name) return true;
    }
  }
  return false;
}

absl::Status SetText(ShaderCall& call, const std::string& name, std::string_view text) {
  if (call.text.emplace(name, text).second) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(Quoted(name), " is given twice"));
}

// "NAME" or "NAME(TEXT)", which gives the shader's text parameter.
absl::Status SetName(ShaderCall& call, std::string_view text) {
  const size_t open = text.find('(');
  call.name = std::string(text.substr(0, open));
  if (call.name.empty()) return absl::InvalidArgumentError(absl::StrCat(Quoted(text), " names no shader"));
  if (open == std::string_view::npos) return absl::OkStatus();
  if (text.back() != ')' || text.size() < open + 3) {
    return absl::InvalidArgumentError(absl::StrCat(Quoted(text), " is not of the form name(text)"));
  }
  const ShaderInfo* info = FindShader(ShaderStage::kFragment, call.name);
  const auto is_text = [](const ShaderParameterInfo& parameter) { return parameter.type == "string"; };
  if (info != nullptr) {
    const auto parameter = std::find_if(info->parameters.begin(), info->parameters.end(), is_text);
    if (parameter != info->parameters.end()) {
      return SetText(call, parameter->name, text.substr(open + 1, text.size() - open - 2));
    }
  }
  return absl::InvalidArgumentError(absl::StrCat(Quoted(call.name), " takes nothing in brackets"));
}

absl::Status SetParameter(ShaderCall& call, const KeyValue& pair) {
  if (IsTextParameter(pair.key)) return SetText(call, pair.key, pair.value);
  absl::StatusOr<std::vector<double>> numbers = ParseNumbers(pair.value, '/');
  if (!numbers.ok())
    return absl::InvalidArgumentError(absl::StrCat(pair.key, ": ", std::string(numbers.status().message())));
  call.parameters[pair.key] = *std::move(numbers);
  return absl::OkStatus();
}

// `components` stays absent if the text gives no number.
absl::Status ParseFormat(std::string_view text, TargetSpec& target, std::optional<int>& components) {
  const size_t cross = text.find('x');
  const std::string_view name = text.substr(0, cross);
  const std::optional<VoxelFormat> format = ParseVoxelFormat(name);
  if (!format)
    return absl::InvalidArgumentError(
        absl::StrCat("unknown format ", Quoted(name), "; known are bit, u8, u16, u32, f16 and f32"));
  target.format = *format;
  if (cross == std::string_view::npos) return absl::OkStatus();
  const std::string_view count = text.substr(cross + 1);
  if (count.size() != 1 || count[0] < '1' || count[0] > '4') {
    return absl::InvalidArgumentError(absl::StrCat("components ", Quoted(count), ": a target has 1 to 4"));
  }
  components = count[0] - '0';
  return absl::OkStatus();
}

absl::Status SetTargetOption(const KeyValue& pair, TargetSpec& target, ShaderCall& own) {
  if (pair.key == "shader") {
    return SetName(own, pair.value);
  }
  if (pair.key == "scale") {
    const absl::StatusOr<double> scale = ParseNumber(pair.value);
    if (!scale.ok()) return absl::InvalidArgumentError(absl::StrCat("scale: ", std::string(scale.status().message())));
    target.scale = *scale;
    return absl::OkStatus();
  }
  if (pair.key == "fill") {
    absl::StatusOr<std::vector<double>> numbers = ParseNumbers(pair.value, '/');
    if (!numbers.ok()) {
      return absl::InvalidArgumentError(absl::StrCat("fill: ", std::string(numbers.status().message())));
    }
    target.fill_values = *std::move(numbers);
    return absl::OkStatus();
  }
  if (pair.key == "encoding") {
    const std::optional<Encoding> encoding = ParseEncoding(pair.value);
    if (!encoding) {
      return absl::InvalidArgumentError(
          absl::StrCat("encoding: ", Quoted(pair.value), " is not known; known are linear, srgb and snorm"));
    }
    target.encoding = *encoding;
    return absl::OkStatus();
  }
  double* number = pair.key == "quantum" ? &target.quantum : pair.key == "clear" ? &target.clear : nullptr;
  if (number == nullptr) return SetParameter(own, pair);
  const absl::StatusOr<double> value = ParseNumber(pair.value);
  if (!value.ok())
    return absl::InvalidArgumentError(absl::StrCat(pair.key, ": ", std::string(value.status().message())));
  *number = *value;
  return absl::OkStatus();
}

absl::Status ParseTargetInto(std::string_view text, const ShaderCall& default_shader, TargetSpec& target) {
  const size_t first = text.find(':');
  if (first == std::string_view::npos)
    return absl::InvalidArgumentError("a target is FORMAT[xC]:BLEND[:name=value,...]");
  std::optional<int> components;
  if (absl::Status status = ParseFormat(text.substr(0, first), target, components); !status.ok()) return status;
  std::string_view rest = text.substr(first + 1);
  const size_t second = rest.find(':');
  const std::string_view blend_name = rest.substr(0, second);
  const std::optional<Blend> blend = ParseBlend(blend_name);
  if (!blend) {
    return absl::InvalidArgumentError(absl::StrCat(
        "unknown blend ", Quoted(blend_name), "; known are or, replace, min, max, add, first, average, count and and"));
  }
  target.blend = *blend;
  ShaderCall own;
  if (second != std::string_view::npos) {
    const absl::StatusOr<std::vector<KeyValue>> pairs = ParseKeyValues(rest.substr(second + 1));
    if (!pairs.ok()) return pairs.status();
    for (const KeyValue& pair : *pairs) {
      if (absl::Status status = SetTargetOption(pair, target, own); !status.ok()) return status;
    }
  }
  if (own.name.empty()) {
    target.shader = default_shader;
    for (auto& [name, value] : own.parameters) target.shader.parameters[name] = value;
    for (auto& [name, value] : own.text) target.shader.text[name] = value;
  } else {
    target.shader = own;
  }
  target.components = components.value_or(OwnComponents(target));
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::vector<double>> ParseNumbers(std::string_view text, char separator) {
  std::vector<double> numbers;
  for (const std::string_view part : Split(text, separator)) {
    const absl::StatusOr<double> number = ParseNumber(part);
    if (!number.ok()) return number.status();
    numbers.push_back(*number);
  }
  return numbers;
}

absl::StatusOr<Vec3d> ParseVoxelSize(std::string_view text) {
  absl::StatusOr<Vec3d> size = ParseVec3(text, true);
  if (size.ok() && !(size->x > 0 && size->y > 0 && size->z > 0)) {
    return absl::InvalidArgumentError(absl::StrCat(Quoted(text), ": a voxel size is greater than 0"));
  }
  return size;
}

absl::StatusOr<Vec3d> ParsePoint(std::string_view text) {
  return ParseVec3(text, false);
}

absl::StatusOr<std::array<int64_t, 3>> ParseDims(std::string_view text) {
  const std::vector<std::string_view> parts = Split(text, ',');
  if (parts.size() != 3) {
    return absl::InvalidArgumentError(absl::StrCat(Quoted(text), " has ", parts.size(), " numbers; three expected"));
  }
  std::array<int64_t, 3> dims{};
  for (size_t a = 0; a < 3; ++a) {
    const auto [end, error] = std::from_chars(parts[a].data(), parts[a].data() + parts[a].size(), dims[a]);
    if (error != std::errc() || end != parts[a].data() + parts[a].size() || dims[a] < 1) {
      return absl::InvalidArgumentError(absl::StrCat(Quoted(parts[a]), " is not a whole number of at least 1"));
    }
  }
  return dims;
}

absl::StatusOr<Box3d> ParseBox(std::string_view text) {
  const absl::StatusOr<std::vector<double>> numbers = ParseNumbers(text, ',');
  if (!numbers.ok()) return numbers.status();
  const std::vector<double>& n = *numbers;
  if (n.size() != 6) {
    return absl::InvalidArgumentError(
        absl::StrCat(Quoted(text), " has ", n.size(), " numbers; six expected, X0,Y0,Z0,X1,Y1,Z1"));
  }
  for (size_t a = 0; a < 3; ++a) {
    if (!std::isfinite(n[a]) || !std::isfinite(n[a + 3])) {
      return absl::InvalidArgumentError(absl::StrCat(Quoted(text), " is not finite"));
    }
    if (n[a] < n[a + 3]) continue;
    return absl::InvalidArgumentError(absl::StrCat(Quoted(text), " is ", n[a] == n[a + 3] ? "empty" : "inverted",
                                                   " along ", std::string(1, "xyz"[a]),
                                                   ": the least corner comes first, then the greatest"));
  }
  return Box3d{{n[0], n[1], n[2]}, {n[3], n[4], n[5]}, false};
}

absl::StatusOr<ShaderCall> ParseShaderCall(std::string_view text) {
  const size_t colon = text.find(':');
  ShaderCall call;
  if (absl::Status status = SetName(call, text.substr(0, colon)); !status.ok()) return status;
  if (colon == std::string_view::npos) return call;
  const absl::StatusOr<std::vector<KeyValue>> pairs = ParseKeyValues(text.substr(colon + 1));
  if (!pairs.ok()) return pairs.status();
  for (const KeyValue& pair : *pairs) {
    if (absl::Status status = SetParameter(call, pair); !status.ok()) return status;
  }
  return call;
}

absl::StatusOr<TargetSpec> ParseTarget(std::string_view text, const ShaderCall& default_shader) {
  TargetSpec target;
  if (absl::Status status = ParseTargetInto(text, default_shader, target); !status.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(Quoted(text), ": ", std::string(status.message())));
  }
  return target;
}

absl::StatusOr<std::vector<TargetSpec>> ResolveTargets(const std::vector<std::string>& targets,
                                                       const std::optional<std::string>& shader) {
  ShaderCall call = TargetSpec{}.shader;
  if (shader) {
    absl::StatusOr<ShaderCall> parsed = ParseShaderCall(*shader);
    if (!parsed.ok()) return parsed.status();
    call = *std::move(parsed);
  }
  if (!targets.empty()) {
    std::vector<TargetSpec> specs;
    for (const std::string& text : targets) {
      absl::StatusOr<TargetSpec> spec = ParseTarget(text, call);
      if (!spec.ok()) return spec.status();
      specs.push_back(*std::move(spec));
    }
    return specs;
  }
  TargetSpec target;
  target.shader = call;
  if (call.name != "occupancy") {
    const absl::StatusOr<BoundShader> bound = BindShader(ShaderStage::kFragment, call);
    if (!bound.ok()) return bound.status();
    target.format = VoxelFormat::kF32;
    target.blend = Blend::kReplace;
    target.components = bound->info->output_components;
  }
  return std::vector<TargetSpec>{target};
}

}  // namespace voxelpipe::cli
