#include "grid/voxel_format.h"

#include <array>
#include <utility>

#include "absl/strings/str_cat.h"

namespace voxelpipe {
namespace {

constexpr std::array kFormats = {
    std::pair{VoxelFormat::kBit, std::string_view("bit")}, std::pair{VoxelFormat::kU8, std::string_view("u8")},
    std::pair{VoxelFormat::kU16, std::string_view("u16")}, std::pair{VoxelFormat::kU32, std::string_view("u32")},
    std::pair{VoxelFormat::kF16, std::string_view("f16")}, std::pair{VoxelFormat::kF32, std::string_view("f32")},
};
constexpr std::array kBlends = {
    std::pair{Blend::kOr, std::string_view("or")},           std::pair{Blend::kReplace, std::string_view("replace")},
    std::pair{Blend::kMin, std::string_view("min")},         std::pair{Blend::kMax, std::string_view("max")},
    std::pair{Blend::kAdd, std::string_view("add")},         std::pair{Blend::kFirst, std::string_view("first")},
    std::pair{Blend::kAverage, std::string_view("average")}, std::pair{Blend::kCount, std::string_view("count")},
    std::pair{Blend::kAnd, std::string_view("and")},
};

constexpr std::array kEncodings = {
    std::pair{Encoding::kLinear, std::string_view("linear")},
    std::pair{Encoding::kSrgb, std::string_view("srgb")},
    std::pair{Encoding::kSnorm, std::string_view("snorm")},
};

template <typename Table, typename Value>
std::string_view NameIn(const Table& table, Value value) {
  for (const auto& [v, name] : table) {
    if (v == value) return name;
  }
  return "unknown";
}

template <typename Table>
auto ValueIn(const Table& table, std::string_view name) -> std::optional<decltype(table[0].first)> {
  for (const auto& [value, text] : table) {
    if (text == name) return value;
  }
  return std::nullopt;
}

}  // namespace

std::string_view Name(VoxelFormat format) {
  return NameIn(kFormats, format);
}
std::string_view Name(Blend blend) {
  return NameIn(kBlends, blend);
}

std::string_view Name(Encoding encoding) {
  return NameIn(kEncodings, encoding);
}

std::optional<VoxelFormat> ParseVoxelFormat(std::string_view name) {
  return ValueIn(kFormats, name);
}
std::optional<Blend> ParseBlend(std::string_view name) {
  return ValueIn(kBlends, name);
}
std::optional<Encoding> ParseEncoding(std::string_view name) {
  return ValueIn(kEncodings, name);
}

int BitsPerComponent(VoxelFormat format) {
  switch (format) {
    case VoxelFormat::kBit: return 1;
    case VoxelFormat::kU8:
    case VoxelFormat::kU8Srgb:
    case VoxelFormat::kU8Snorm: return 8;
    case VoxelFormat::kU16:
    case VoxelFormat::kU16Snorm:
    case VoxelFormat::kF16: return 16;
    case VoxelFormat::kU32:
    case VoxelFormat::kF32: return 32;
  }
  return 0;
}

absl::Status CheckBlend(VoxelFormat format, Blend blend) {
  const bool logical = blend == Blend::kOr || blend == Blend::kAnd;
  bool defined = true;
  if (format == VoxelFormat::kBit) {
    defined = logical || blend == Blend::kReplace || blend == Blend::kFirst || blend == Blend::kCount;
  } else if (format == VoxelFormat::kF16 || format == VoxelFormat::kF32) {
    defined = !logical;
  }
  if (defined) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("blend '", std::string(Name(blend)), "' is not defined for format '", std::string(Name(format)),
                   "' (bit: or, and, replace, first, count; integers: all; floats: all but and, or)"));
}

}  // namespace voxelpipe
