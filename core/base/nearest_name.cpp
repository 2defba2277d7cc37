// Source: F. Damerau, "A Technique for Computer Detection and Correction of Spelling Errors", Communications of the ACM
// 7(3), 1964; here each pair of bytes is swapped at most once (optimal string alignment).
#include "base/nearest_name.h"

#include <algorithm>
#include <array>
#include <cstdint>

#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace voxelpipe {
namespace {

constexpr size_t kMaxNameBytes = 100;

size_t Edits(std::string_view a, std::string_view b) {
  std::array<std::array<uint8_t, kMaxNameBytes + 1>, kMaxNameBytes + 1> edits{};  // of the first i bytes to the first j
  const auto same = [&](size_t i, size_t j) { return absl::ascii_tolower(a[i]) == absl::ascii_tolower(b[j]); };
  for (size_t i = 0; i <= a.size(); ++i) {
    for (size_t j = 0; j <= b.size(); ++j) {
      if (i == 0 || j == 0) {
        edits[i][j] = uint8_t(i + j);
        continue;
      }
      int fewest =
          std::min({edits[i - 1][j] + 1, edits[i][j - 1] + 1, edits[i - 1][j - 1] + (same(i - 1, j - 1) ? 0 : 1)});
      const bool swapped = i > 1 && j > 1 && same(i - 1, j - 2) && same(i - 2, j - 1);
      if (swapped) fewest = std::min(fewest, edits[i - 2][j - 2] + 1);
      edits[i][j] = uint8_t(fewest);
    }
  }
  return edits[a.size()][b.size()];
}

}  // namespace

std::string NearestName(std::string_view name, const std::vector<std::string>& known) {
  constexpr size_t kMaxEdits = 3;
  if (name.empty() || name.size() > kMaxNameBytes) return "";
  // The other word for the same thing, which is as near to its opposite.
  const bool gpu = absl::AsciiStrToLower(std::string(name)) == "gpu";
  if (gpu && std::find(known.begin(), known.end(), "cuda") != known.end()) return "cuda";
  size_t fewest = std::clamp(name.size() / 3, size_t{1}, kMaxEdits) + 1;
  const std::string* nearest = nullptr;
  for (const std::string& candidate : known) {
    if (candidate.size() > kMaxNameBytes) continue;
    const size_t edits = Edits(name, candidate);
    // Of equally near names the one that was cut short: "fil" is "fill" before "fit".
    const bool begun = edits == fewest && nearest != nullptr && candidate.starts_with(name);
    if (edits >= fewest && !begun) continue;
    fewest = edits;
    nearest = &candidate;
  }
  return nearest == nullptr ? "" : *nearest;
}

std::string DidYouMean(std::string_view name, const std::vector<std::string>& known) {
  const std::string nearest = NearestName(name, known);
  return nearest.empty() ? "" : absl::StrCat("did you mean '", nearest, "'?");
}

std::string UnknownChoice(std::string_view text, const std::vector<std::string>& known) {
  const std::string nearest = DidYouMean(text, known);
  return absl::StrCat("unknown choice '", std::string(text), "'; ", nearest, nearest.empty() ? "" : " ", "known are ",
                      absl::StrJoin(known, ", "));
}

}  // namespace voxelpipe
