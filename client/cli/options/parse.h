// Parsers of command-line values: vectors, shader calls, targets.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "base/vec.h"
#include "grid/grid_spec.h"
#include "job/request.h"

namespace voxelpipe::cli {

// All errors here are INVALID_ARGUMENT and quote the text at fault.

// "1/0.5/2" with separator '/': the numbers between the separators, each complete and not NaN.
absl::StatusOr<std::vector<double>> ParseNumbers(std::string_view text, char separator);

// "H" (all three axes) or "HX,HY,HZ"; finite and positive.
absl::StatusOr<Vec3d> ParseVoxelSize(std::string_view text);
// "X,Y,Z"; finite.
absl::StatusOr<Vec3d> ParsePoint(std::string_view text);
// "X,Y,Z"; whole numbers of at least 1.
absl::StatusOr<std::array<int64_t, 3>> ParseDims(std::string_view text);

// "X0,Y0,Z0,X1,Y1,Z1": the least and the greatest corner of a box with a volume; finite.
absl::StatusOr<Box3d> ParseBox(std::string_view text);

// "NAME" or "NAME:k=v,k=v"; a vector's numbers are separated by '/': "constant:value=0.5/0.2/1". A text parameter may
// be given in brackets: "attribute(_HEAT)" is "attribute:name=_HEAT". Neither the name nor the parameters are checked
// against the catalog.
absl::StatusOr<ShaderCall> ParseShaderCall(std::string_view text);

// "FORMAT[xC]:BLEND[:k=v,...]" where k is shader, quantum, clear, fill ("V" or "A/B/C"), encoding (linear, srgb or
// snorm), scale (integer formats only), or a parameter of the target's shader. A target without shader= takes
// `default_shader` with its own parameters on top; one without xC has the components of its shader (OwnComponents).
absl::StatusOr<TargetSpec> ParseTarget(std::string_view text, const ShaderCall& default_shader);

// The targets of --target and --shader. Without --target: `bit:or` for occupancy (also if no shader is named),
// otherwise `f32xC:replace`, C the number of components of the shader.
absl::StatusOr<std::vector<TargetSpec>> ResolveTargets(const std::vector<std::string>& targets,
                                                       const std::optional<std::string>& shader);

}  // namespace voxelpipe::cli
