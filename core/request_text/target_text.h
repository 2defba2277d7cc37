// The render targets of a request as text.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "job/request.h"

namespace voxelpipe {

// "[SHADER][:FORMAT[xC]][:BLEND][:key=value,...]", such as "bit", "normal:f32", "base_color:srgb8",
// "attribute(_HEAT):f32x1:average", "f32x3:replace:shader=normal,clear=-1". At least one part is there.
//
// SHADER: NAME or NAME(TEXT); without one the target takes `default_shader`, with its own parameters on top.
// FORMAT: bit, u8, u16, u32, f16, f32, or srgb8, which is u8 with the encoding srgb. Default: bit for occupancy, else
// f32. C: 1 to 4 components; default: those of the shader (OwnComponents). BLEND: default `or` for bit, else `replace`.
// Keys: shader (in place of SHADER), clear, scale and quantum (a number), fill ("V" or "A/B/C"), encoding (linear, srgb
// or snorm), or a parameter of the shader (ParseShaderCall). Errors: INVALID_ARGUMENT quoting the text.
absl::StatusOr<TargetSpec> ParseTarget(std::string_view text, const ShaderCall& default_shader);

// The targets of a request: each of `targets`, or without any one target of the shader.
absl::StatusOr<std::vector<TargetSpec>> ParseTargets(const std::vector<std::string>& targets,
                                                     const std::optional<std::string>& shader);

}  // namespace voxelpipe
