#include "base/warning.h"

#include <algorithm>
#include <utility>

namespace voxelpipe {
namespace {

// Cuts before a UTF-8 sequence, never inside of it.
std::string Cut(std::string_view text) {
  constexpr std::string_view kMore = "...";
  if (text.size() <= WarningList::kMaxTextBytes) return std::string(text);
  size_t end = WarningList::kMaxTextBytes - kMore.size();
  while (end > 0 && (static_cast<uint8_t>(text[end]) & 0xC0) == 0x80) --end;
  return std::string(text.substr(0, end)).append(kMore);
}

}  // namespace

std::string_view Name(WarningCode code) {
  switch (code) {
    case WarningCode::kTextureMissing: return "texture_missing";
    case WarningCode::kTextureUndecodable: return "texture_undecodable";
    case WarningCode::kIndicesLeftOver: return "indices_left_over";
    case WarningCode::kNoScene: return "no_scene";
    case WarningCode::kNoTriangles: return "no_triangles";
    case WarningCode::kAllDiscarded: return "all_discarded";
    case WarningCode::kExtensionIgnored: return "extension_ignored";
    case WarningCode::kCountMismatch: return "count_mismatch";
    case WarningCode::kNonconformingFile: return "nonconforming_file";
    case WarningCode::kNotKept: return "not_kept";
    case WarningCode::kFillHasNoValue: return "fill_has_no_value";
    case WarningCode::kOutsideGrid: return "outside_grid";
    case WarningCode::kValuesRounded: return "values_rounded";
    case WarningCode::kPartNotFound: return "part_not_found";
    case WarningCode::kPartOpen: return "part_open";
  }
  return "nonconforming_file";
}

std::optional<WarningCode> WarningCodeOf(std::string_view name) {
  for (int i = 0; i <= int(WarningCode::kPartOpen); ++i) {
    if (Name(WarningCode(i)) == name) return WarningCode(i);
  }
  return std::nullopt;
}

std::string Warning::Line() const {
  return place.empty() ? text : place + ": " + text;
}

void WarningList::Add(WarningCode code, std::string_view place, std::string_view text) {
  Warning warning{code, Cut(place), Cut(text)};
  if (std::find(kept_.begin(), kept_.end(), warning) != kept_.end()) return;
  if (kept_.size() == kMaxWarnings) {
    ++left_out_;
  } else {
    kept_.push_back(std::move(warning));
  }
}

void WarningList::Append(const WarningList& others) {
  for (const Warning& warning : others.kept_) Add(warning.code, warning.place, warning.text);
  left_out_ += others.left_out_;
}

}  // namespace voxelpipe
