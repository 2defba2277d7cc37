// Numbers in the texts of a request. All errors are INVALID_ARGUMENT and quote the text at fault.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "base/vec.h"
#include "grid/grid_spec.h"

namespace voxelpipe {

// 'text'
std::string QuotedText(std::string_view text);

// The parts of `text` between separators outside of brackets; one part if there is no separator.
std::vector<std::string_view> SplitOutsideBrackets(std::string_view text, char separator);

// A decimal number, or inf, with a sign or without; no NaN, no space.
absl::StatusOr<double> ParseNumber(std::string_view text);

// A whole number from `min` to `max`, with a minus sign or without.
absl::StatusOr<int64_t> ParseWhole(std::string_view text, int64_t min, int64_t max);

// "1/0.5/2" with separator '/': the numbers between the separators.
absl::StatusOr<std::vector<double>> ParseNumbers(std::string_view text, char separator);

// "H" (all three axes) or "HX,HY,HZ"; finite and positive.
absl::StatusOr<Vec3d> ParseVoxelSize(std::string_view text);
// "X,Y,Z"; finite.
absl::StatusOr<Vec3d> ParsePoint(std::string_view text);
// "X,Y,Z"; whole numbers of at least 1.
absl::StatusOr<std::array<int64_t, 3>> ParseDims(std::string_view text);
// "X0,Y0,Z0,X1,Y1,Z1": the least and the greatest corner of a box with a volume; finite.
absl::StatusOr<Box3d> ParseBox(std::string_view text);

}  // namespace voxelpipe
