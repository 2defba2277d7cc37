#include "grid/voxel_format.h"

#include <array>
#include <utility>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

constexpr std::array kFormats = {std::pair{VoxelFormat::kBit, std::string_view("bit")},
                                 std::pair{VoxelFormat::kF32, std::string_view("f32")}};
constexpr std::array kBlends = {
    std::pair{Blend::kOr, std::string_view("or")},   std::pair{Blend::kReplace, std::string_view("replace")},
    std::pair{Blend::kMin, std::string_view("min")}, std::pair{Blend::kMax, std::string_view("max")},
    std::pair{Blend::kAdd, std::string_view("add")},
};

template <typename Table, typename Value>
std::string_view NameIn(const Table& table, Value value) {
  for (const auto& [v, name] : table) {
    if (v == value) return name;
  }
  return "unknown";
}

}  // namespace

std::string_view Name(VoxelFormat format) {
  return NameIn(kFormats, format);
}
std::string_view Name(Blend blend) {
  return NameIn(kBlends, blend);
}

std::optional<VoxelFormat> ParseVoxelFormat(std::string_view name) {
  for (const auto& [value, text] : kFormats) {
    if (text == name) return value;
  }
  return std::nullopt;
}

std::optional<Blend> ParseBlend(std::string_view name) {
  for (const auto& [value, text] : kBlends) {
    if (text == name) return value;
  }
  return std::nullopt;
}

int BitsPerComponent(VoxelFormat format) {
  return format == VoxelFormat::kBit ? 1 : 32;
}

absl::Status CheckBlend(VoxelFormat format, Blend blend) {
  const bool defined =
      format == VoxelFormat::kBit ? blend == Blend::kOr || blend == Blend::kReplace : blend != Blend::kOr;
  if (defined) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("blend '", std::string(Name(blend)), "' is not defined for format '",
                                                 std::string(Name(format)),
                                                 "' (bit: or, replace; f32: replace, min, max, add)"));
}

}  // namespace voxelpipe
