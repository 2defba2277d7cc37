// Units of length of mesh files.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

namespace voxelpipe {

enum class LengthUnit : uint8_t { kNone, kMillimetre, kCentimetre, kMetre, kInch };

// "mm", "cm", "m", "in"; empty for kNone.
constexpr std::string_view Name(LengthUnit unit) {
  switch (unit) {
    case LengthUnit::kMillimetre: return "mm";
    case LengthUnit::kCentimetre: return "cm";
    case LengthUnit::kMetre: return "m";
    case LengthUnit::kInch: return "in";
    case LengthUnit::kNone: break;
  }
  return "";
}

// The unit of that name; empty if there is none.
constexpr std::optional<LengthUnit> LengthUnitOf(std::string_view name) {
  for (const LengthUnit unit :
       {LengthUnit::kMillimetre, LengthUnit::kCentimetre, LengthUnit::kMetre, LengthUnit::kInch}) {
    if (name == Name(unit)) return unit;
  }
  return std::nullopt;
}

// 1 for kNone.
constexpr double MetresOf(LengthUnit unit) {
  switch (unit) {
    case LengthUnit::kMillimetre: return 0.001;
    case LengthUnit::kCentimetre: return 0.01;
    case LengthUnit::kInch: return 0.0254;
    case LengthUnit::kMetre:
    case LengthUnit::kNone: break;
  }
  return 1;
}

}  // namespace voxelpipe
