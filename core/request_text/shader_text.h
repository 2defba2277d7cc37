// A shader of a request as text.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "job/request.h"

namespace voxelpipe {

// "NAME" or "NAME:key=value,key=value". A value is numbers, separated by '/': "constant:value=0.5/0.2/1". What is none
// is a text, and so is that of the key `name`, which may stand in brackets: "attribute(_HEAT)" is
// "attribute:name=_HEAT". Neither the name nor the parameters are checked against the catalog (BindShader). Errors:
// INVALID_ARGUMENT quoting the text at fault.
absl::StatusOr<ShaderCall> ParseShaderCall(std::string_view text);

// ---- for the texts of targets ----

// A key and its value.
struct TextSetting {
  std::string key;
  std::string_view value;
};

// "key=value,key=value", each key once; separators in brackets are a part of the value.
absl::StatusOr<std::vector<TextSetting>> ParseSettings(std::string_view text);

// "NAME" or "NAME(TEXT)", into an empty call.
absl::Status SetShaderName(std::string_view text, ShaderCall& call);

// A parameter of the shader, which does not have it yet.
absl::Status SetShaderParameter(const TextSetting& setting, ShaderCall& call);

}  // namespace voxelpipe
