#include "request_text/numbers.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "absl/strings/ascii.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

absl::StatusOr<Vec3d> ParseVec3(std::string_view text, bool one_for_all) {
  absl::StatusOr<std::vector<double>> numbers = ParseNumbers(text, ',');
  if (!numbers.ok()) return numbers.status();
  if (one_for_all && numbers->size() == 1) numbers->resize(3, numbers->front());
  if (numbers->size() != 3) {
    return absl::InvalidArgumentError(absl::StrCat(QuotedText(text), " has ", numbers->size(), " numbers; ",
                                                   one_for_all ? "one or three" : "three", " expected"));
  }
  for (const double number : *numbers) {
    if (!std::isfinite(number)) return absl::InvalidArgumentError(absl::StrCat(QuotedText(text), " is not finite"));
  }
  return Vec3d{(*numbers)[0], (*numbers)[1], (*numbers)[2]};
}

}  // namespace

std::string QuotedText(std::string_view text) {
  return absl::StrCat("'", std::string(text), "'");
}

std::vector<std::string_view> SplitOutsideBrackets(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  size_t begin = 0;
  bool inside = false;
  for (size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '(') inside = true;
    if (text[i] == ')') inside = false;
    if (inside || text[i] != separator) continue;
    parts.push_back(text.substr(begin, i - begin));
    begin = i + 1;
  }
  parts.push_back(text.substr(begin));
  return parts;
}

absl::StatusOr<double> ParseNumber(std::string_view text) {
  double value = 0;
  // Neither spaces nor hexadecimal digits, which absl takes.
  const auto other = [](char c) { return absl::ascii_isspace(uint8_t(c)) || c == 'x' || c == 'X'; };
  const bool decimal = std::none_of(text.begin(), text.end(), other);
  if (!decimal || !absl::SimpleAtod(std::string(text), &value) || std::isnan(value)) {
    return absl::InvalidArgumentError(absl::StrCat(QuotedText(text), " is not a number"));
  }
  return value;
}

absl::StatusOr<std::vector<double>> ParseNumbers(std::string_view text, char separator) {
  std::vector<double> numbers;
  for (const std::string_view part : SplitOutsideBrackets(text, separator)) {
    const absl::StatusOr<double> number = ParseNumber(part);
    if (!number.ok()) return number.status();
    numbers.push_back(*number);
  }
  return numbers;
}

absl::StatusOr<Vec3d> ParseVoxelSize(std::string_view text) {
  absl::StatusOr<Vec3d> size = ParseVec3(text, true);
  if (size.ok() && !(size->x > 0 && size->y > 0 && size->z > 0)) {
    return absl::InvalidArgumentError(absl::StrCat(QuotedText(text), ": a voxel size is greater than 0"));
  }
  return size;
}

absl::StatusOr<Vec3d> ParsePoint(std::string_view text) {
  return ParseVec3(text, false);
}

absl::StatusOr<int64_t> ParseWhole(std::string_view text, int64_t min, int64_t max) {
  int64_t number = 0;
  const char* const stop = text.data() + text.size();
  const auto [end, error] = std::from_chars(text.data(), stop, number);
  if (error == std::errc() && end == stop && number >= min && number <= max) return number;
  return absl::InvalidArgumentError(absl::StrCat(QuotedText(text), " is no whole number from ", min, " to ", max));
}

absl::StatusOr<std::array<int64_t, 3>> ParseDims(std::string_view text) {
  const std::vector<std::string_view> parts = SplitOutsideBrackets(text, ',');
  if (parts.size() != 3) {
    return absl::InvalidArgumentError(
        absl::StrCat(QuotedText(text), " has ", parts.size(), " numbers; three expected"));
  }
  std::array<int64_t, 3> dims{};
  for (size_t a = 0; a < 3; ++a) {
    const auto [end, error] = std::from_chars(parts[a].data(), parts[a].data() + parts[a].size(), dims[a]);
    if (error != std::errc() || end != parts[a].data() + parts[a].size() || dims[a] < 1) {
      return absl::InvalidArgumentError(absl::StrCat(QuotedText(parts[a]), " is not a whole number of at least 1"));
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
        absl::StrCat(QuotedText(text), " has ", n.size(), " numbers; six expected, X0,Y0,Z0,X1,Y1,Z1"));
  }
  for (size_t a = 0; a < 3; ++a) {
    if (!std::isfinite(n[a]) || !std::isfinite(n[a + 3])) {
      return absl::InvalidArgumentError(absl::StrCat(QuotedText(text), " is not finite"));
    }
    if (n[a] < n[a + 3]) continue;
    return absl::InvalidArgumentError(absl::StrCat(QuotedText(text), " is ", n[a] == n[a + 3] ? "empty" : "inverted",
                                                   " along ", std::string(1, "xyz"[a]),
                                                   ": the least corner comes first, then the greatest"));
  }
  return Box3d{{n[0], n[1], n[2]}, {n[3], n[4], n[5]}, false};
}

}  // namespace voxelpipe
