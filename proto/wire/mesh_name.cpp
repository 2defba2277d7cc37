#include "wire/mesh_name.h"

#include <algorithm>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

constexpr size_t kDigits = 64;

constexpr LengthUnit kUnits[] = {LengthUnit::kMillimetre, LengthUnit::kCentimetre, LengthUnit::kMetre,
                                 LengthUnit::kInch};
constexpr MeshFormat kFormats[] = {MeshFormat::kGlb, MeshFormat::kGltf, MeshFormat::kDraco, MeshFormat::kStl,
                                   MeshFormat::kPly, MeshFormat::kOff,  MeshFormat::kObj,   MeshFormat::k3mf};

// Removes "-" and the name of one of these from the beginning of `text`.
template <typename Value, size_t N>
void Drop(const Value (&values)[N], std::string_view& text) {
  for (const Value value : values) {
    const std::string suffix = absl::StrCat("-", std::string(Name(value)));
    const std::string_view rest = text.substr(std::min(text.size(), suffix.size()));
    if (text.substr(0, suffix.size()) != suffix || (!rest.empty() && rest[0] != '-')) continue;
    text = rest;
    return;
  }
}

}  // namespace

absl::Status CheckMeshName(std::string_view name, std::string_view field) {
  std::string_view rest = name;
  const bool begins = rest.substr(0, kMeshCollection.size()) == kMeshCollection;
  if (begins) rest.remove_prefix(kMeshCollection.size());
  const std::string_view digits = rest.substr(0, kDigits);
  const bool hexadecimal = std::all_of(digits.begin(), digits.end(),
                                       [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
  if (begins && digits.size() == kDigits && hexadecimal) {
    rest.remove_prefix(kDigits);
    Drop(kUnits, rest);
    Drop(kFormats, rest);
    if (rest.empty()) return absl::OkStatus();
  }
  return absl::InvalidArgumentError(
      absl::StrCat(std::string(field),
                   ": must be meshes/ and 64 hexadecimal digits, lower case, then unit and format "
                   "where they were given, such as -mm-stl"));
}

}  // namespace voxelpipe
