#include "request_text/shader_text.h"

#include <algorithm>
#include <utility>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "request_text/numbers.h"

namespace voxelpipe {
namespace {

// A letter or '_', then letters, digits and '_'.
bool IsName(std::string_view text) {
  const auto fits = [](char c) { return absl::ascii_isalnum(uint8_t(c)) || c == '_'; };
  return !text.empty() && !absl::ascii_isdigit(uint8_t(text.front())) && std::all_of(text.begin(), text.end(), fits);
}

}  // namespace

absl::StatusOr<std::vector<TextSetting>> ParseSettings(std::string_view text) {
  std::vector<TextSetting> settings;
  for (const std::string_view part : SplitOutsideBrackets(text, ',')) {
    const size_t equals = part.find('=');
    if (equals == std::string_view::npos || equals == 0 || equals + 1 == part.size()) {
      return absl::InvalidArgumentError(absl::StrCat(QuotedText(part), " is not key=value"));
    }
    const std::string key(part.substr(0, equals));
    for (const TextSetting& other : settings) {
      if (other.key == key) return absl::InvalidArgumentError(absl::StrCat(QuotedText(key), " is given twice"));
    }
    settings.push_back({key, part.substr(equals + 1)});
  }
  return settings;
}

absl::Status SetShaderName(std::string_view text, ShaderCall& call) {
  const size_t open = text.find('(');
  const std::string_view name = text.substr(0, open);
  std::string_view inner;
  bool right = IsName(name);
  if (right && open != std::string_view::npos) {
    inner = text.substr(open + 1);
    right = inner.size() > 1 && inner.find_first_of("()") == inner.size() - 1 && inner.back() == ')';
    if (right) inner.remove_suffix(1);
  }
  if (!right) return absl::InvalidArgumentError(absl::StrCat(QuotedText(text), " is no shader: NAME or NAME(TEXT)"));
  call.name = std::string(name);
  if (!inner.empty()) call.text["name"] = std::string(inner);
  return absl::OkStatus();
}

absl::Status SetShaderParameter(const TextSetting& setting, ShaderCall& call) {
  if (call.parameters.contains(setting.key) || call.text.contains(setting.key)) {
    return absl::InvalidArgumentError(absl::StrCat(QuotedText(setting.key), " is given twice"));
  }
  absl::StatusOr<std::vector<double>> numbers = ParseNumbers(setting.value, '/');
  if (numbers.ok() && setting.key != "name") {
    call.parameters[setting.key] = *std::move(numbers);
  } else {
    call.text[setting.key] = std::string(setting.value);
  }
  return absl::OkStatus();
}

absl::StatusOr<ShaderCall> ParseShaderCall(std::string_view text) {
  const std::string_view name = SplitOutsideBrackets(text, ':').front();
  ShaderCall call;
  if (absl::Status status = SetShaderName(name, call); !status.ok()) return status;
  if (name.size() == text.size()) return call;
  const absl::StatusOr<std::vector<TextSetting>> settings = ParseSettings(text.substr(name.size() + 1));
  if (!settings.ok()) return settings.status();
  for (const TextSetting& setting : *settings) {
    if (absl::Status status = SetShaderParameter(setting, call); !status.ok()) return status;
  }
  return call;
}

}  // namespace voxelpipe
