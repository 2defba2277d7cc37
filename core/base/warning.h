// Warnings: inputs that were accepted although something in them is wrong or could not be used.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace voxelpipe {

enum class WarningCode : uint8_t {
  kTextureMissing,      // an image has no bytes: its file is missing, or none is named
  kTextureUndecodable,  // an image of a format that is not decoded
  kIndicesLeftOver,     // indices after the last whole triangle
  kNoScene,             // the file has no scenes
  kNoTriangles,         // there is nothing to voxelize
  kAllDiscarded,        // alpha masks discarded every fragment
  kExtensionIgnored,    // an extension of extensionsRequired that changes nothing here
  kCountMismatch,       // two parts of the file give different counts
  kNonconformingFile,   // the file breaks a rule of its format, without consequence for the result
  kNotKept,             // the format of the output does not hold a part of the result
  kFillHasNoValue,      // the filled voxels of a target hold its `clear`, as its shader has no value without a triangle
  kOutsideGrid,         // no triangle reaches the grid
  kValuesRounded,       // a target of integers rounds a shader's fractions to whole numbers
  kPartNotFound,        // a pattern of the request's parts matches none
  kPartOpen,            // a part that is filled has open edges
};

// The name on the wire and in JSON: "texture_missing", ...
std::string_view Name(WarningCode code);
// The code of that name; empty if there is none.
std::optional<WarningCode> WarningCodeOf(std::string_view name);

struct Warning {
  WarningCode code = WarningCode::kNonconformingFile;
  std::string place;  // the part of the input, such as "image 3"; empty: the whole
  std::string text;   // what is wrong and what was done, one line

  // "place: text", or the text alone.
  std::string Line() const;
  friend bool operator==(const Warning&, const Warning&) = default;
};

// Keeps the first kMaxWarnings and counts the rest, so that a broken file costs a bounded amount of memory. Drops
// duplicates of kept warnings.
class WarningList {
 public:
  static constexpr size_t kMaxWarnings = 100;
  static constexpr size_t kMaxTextBytes = 256;  // each of place and text; longer ones are cut and end with "..."

  void Add(WarningCode code, std::string_view place, std::string_view text);
  void Append(const WarningList& others);

  bool empty() const { return kept_.empty(); }
  const std::vector<Warning>& kept() const { return kept_; }
  uint64_t left_out() const { return left_out_; }
  void set_left_out(uint64_t count) { left_out_ = count; }

  friend bool operator==(const WarningList&, const WarningList&) = default;

 private:
  std::vector<Warning> kept_;
  uint64_t left_out_ = 0;  // beyond those kept
};

}  // namespace voxelpipe
