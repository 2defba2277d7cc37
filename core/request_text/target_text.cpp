#include "request_text/target_text.h"

#include <algorithm>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "request_text/numbers.h"
#include "request_text/shader_text.h"
#include "shaders/catalog.h"

namespace voxelpipe {
namespace {

constexpr char kFormats[] = "bit, u8, u16, u32, f16, f32 and srgb8";
constexpr char kBlends[] = "or, replace, min, max, add, first, average, count and and";

// What a text gives of a target, besides its shader's parameters.
struct Given {
  std::optional<VoxelFormat> format{};
  std::optional<int> components{};
  std::optional<Blend> blend{};
  std::optional<Encoding> encoding{};
  ShaderCall shader{};  // its name is empty if there is none
};

// True for what can only be meant as a format, right or wrong: "u7", "f32x5", "srgb".
bool LooksLikeFormat(std::string_view text) {
  const std::string_view name = text.substr(0, text.find('x'));
  const auto digits = [](std::string_view t) {
    return std::all_of(t.begin(), t.end(), [](char c) { return absl::ascii_isdigit(uint8_t(c)); });
  };
  if (name.size() < text.size() && !digits(text.substr(name.size() + 1))) return false;
  if (name == "bit" || name == "srgb" || name == "srgb8") return true;
  return name.size() > 1 && std::string_view("ufi").find(name.front()) != std::string_view::npos &&
         digits(name.substr(1));
}

absl::Status ReadFormat(std::string_view text, Given& given) {
  const size_t cross = text.find('x');
  std::string_view name = text.substr(0, cross);
  if (name == "srgb8") {
    name = "u8";
    given.encoding = Encoding::kSrgb;
  }
  given.format = ParseVoxelFormat(name);
  bool right = given.format.has_value();
  if (cross != std::string_view::npos) {
    const std::string_view count = text.substr(cross + 1);
    right = right && count.size() == 1 && count[0] >= '1' && count[0] <= '4';
    if (right) given.components = count[0] - '0';
  }
  if (right) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat(QuotedText(text), " is no format; known are ", kFormats, ", with x1 to x4 for components"));
}

// SHADER, FORMAT and BLEND, each of which may be missing.
absl::Status ReadParts(const std::vector<std::string_view>& parts, Given& given) {
  auto part = parts.begin();
  if (part != parts.end() && !LooksLikeFormat(*part)) {
    if (absl::Status s = SetShaderName(*part++, given.shader); !s.ok()) return s;
  }
  if (part != parts.end() && LooksLikeFormat(*part)) {
    if (absl::Status s = ReadFormat(*part++, given); !s.ok()) return s;
  }
  if (part == parts.end()) return absl::OkStatus();
  given.blend = ParseBlend(*part);
  if (!given.blend) {
    const bool format_is_open = !given.format;
    return absl::InvalidArgumentError(absl::StrCat(QuotedText(*part), " is no ", format_is_open ? "format and no " : "",
                                                   "blend; known are ", format_is_open ? kFormats : "",
                                                   format_is_open ? ", and " : "", kBlends));
  }
  if (++part == parts.end()) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(QuotedText(*part), " is left over: keys and values end a target"));
}

absl::Status AtKey(const std::string& key, const absl::Status& status) {
  return absl::InvalidArgumentError(absl::StrCat(key, ": ", std::string(status.message())));
}

absl::Status ReadSetting(const TextSetting& setting, Given& given, ShaderCall& extra, TargetSpec& target) {
  if (setting.key == "shader") {
    if (given.shader.name.empty()) return SetShaderName(setting.value, given.shader);
    return absl::InvalidArgumentError("the target names two shaders");
  }
  if (setting.key == "encoding") {
    if (given.encoding) return absl::InvalidArgumentError("srgb8 has the encoding srgb: leave encoding out");
    given.encoding = ParseEncoding(setting.value);
    if (given.encoding) return absl::OkStatus();
    return absl::InvalidArgumentError(
        absl::StrCat("encoding: ", QuotedText(setting.value), " is not known; known are linear, srgb and snorm"));
  }
  if (setting.key == "fill") {
    absl::StatusOr<std::vector<double>> numbers = ParseNumbers(setting.value, '/');
    if (!numbers.ok()) return AtKey(setting.key, numbers.status());
    target.fill_values = *std::move(numbers);
    return absl::OkStatus();
  }
  if (setting.key != "clear" && setting.key != "scale" && setting.key != "quantum") {
    return SetShaderParameter(setting, extra);
  }
  const absl::StatusOr<double> number = ParseNumber(setting.value);
  if (!number.ok()) return AtKey(setting.key, number.status());
  if (setting.key == "clear") target.clear = *number;
  if (setting.key == "scale") target.scale = *number;
  if (setting.key == "quantum") target.quantum = *number;
  return absl::OkStatus();
}

// The shader with the parameters of `extra`, which a shader of the target's own must not have yet.
absl::Status Merge(const ShaderCall& extra, bool own, ShaderCall& shader) {
  const auto is_there = [&](const std::string& key) {
    return shader.parameters.contains(key) || shader.text.contains(key);
  };
  const auto add = [&](const auto& from, auto& to) -> absl::Status {
    for (const auto& [key, value] : from) {
      if (own && is_there(key)) return absl::InvalidArgumentError(absl::StrCat(QuotedText(key), " is given twice"));
      shader.parameters.erase(key);
      shader.text.erase(key);
      to[key] = value;
    }
    return absl::OkStatus();
  };
  if (absl::Status s = add(extra.parameters, shader.parameters); !s.ok()) return s;
  return add(extra.text, shader.text);
}

absl::Status ReadTarget(std::string_view text, const ShaderCall& default_shader, TargetSpec& target) {
  std::vector<std::string_view> parts = SplitOutsideBrackets(text, ':');
  for (const std::string_view part : parts) {
    if (part.empty()) return absl::InvalidArgumentError("it has an empty part");
  }
  std::vector<TextSetting> settings;
  if (SplitOutsideBrackets(parts.back(), '=').size() > 1) {
    absl::StatusOr<std::vector<TextSetting>> read = ParseSettings(parts.back());
    if (!read.ok()) return read.status();
    settings = *std::move(read);
    parts.pop_back();
  }
  Given given;
  if (absl::Status s = ReadParts(parts, given); !s.ok()) return s;
  ShaderCall extra;
  for (const TextSetting& setting : settings) {
    if (absl::Status s = ReadSetting(setting, given, extra, target); !s.ok()) return s;
  }
  const bool own = !given.shader.name.empty();
  target.shader = own ? given.shader : default_shader;
  if (absl::Status s = Merge(extra, own, target.shader); !s.ok()) return s;
  target.format = given.format.value_or(target.shader.name == "occupancy" ? VoxelFormat::kBit : VoxelFormat::kF32);
  target.blend = given.blend.value_or(target.format == VoxelFormat::kBit ? Blend::kOr : Blend::kReplace);
  target.encoding = given.encoding.value_or(Encoding::kLinear);
  target.components = given.components.value_or(OwnComponents(target));
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<TargetSpec> ParseTarget(std::string_view text, const ShaderCall& default_shader) {
  TargetSpec target;
  if (absl::Status status = ReadTarget(text, default_shader, target); !status.ok()) {
    return absl::InvalidArgumentError(absl::StrCat(QuotedText(text), ": ", std::string(status.message())));
  }
  return target;
}

absl::StatusOr<std::vector<TargetSpec>> ParseTargets(const std::vector<std::string>& targets,
                                                     const std::optional<std::string>& shader) {
  ShaderCall call = TargetSpec{}.shader;
  if (shader) {
    absl::StatusOr<ShaderCall> parsed = ParseShaderCall(*shader);
    if (!parsed.ok()) return parsed.status();
    call = *std::move(parsed);
  }
  std::vector<TargetSpec> specs;
  for (const std::string& text : targets) {
    absl::StatusOr<TargetSpec> spec = ParseTarget(text, call);
    if (!spec.ok()) return spec.status();
    specs.push_back(*std::move(spec));
  }
  if (!specs.empty()) return specs;
  TargetSpec target;
  target.shader = call;
  if (call.name != "occupancy") {
    if (const auto bound = BindShader(ShaderStage::kFragment, call); !bound.ok()) return bound.status();
    target.format = VoxelFormat::kF32;
    target.blend = Blend::kReplace;
    target.components = OwnComponents(target);
  }
  return std::vector<TargetSpec>{target};
}

}  // namespace voxelpipe
