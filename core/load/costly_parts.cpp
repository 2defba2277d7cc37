#include "load/costly_parts.h"

#include <cstring>
#include <optional>
#include <string_view>

namespace voxelpipe {
namespace {

constexpr CostlyParts kAll{true, true, true};
constexpr size_t kGlbHeaderBytes = 20;  // of the file and of its first chunk, the text
constexpr size_t kTextBytesAt = 12;

bool Contains(std::string_view text, std::string_view part) {
  return memmem(text.data(), text.size(), part.data(), part.size()) != nullptr;  // std's searches byte by byte
}

}  // namespace

CostlyParts FindCostlyParts(std::span<const uint8_t> beginning, MeshFormat format) {
  const bool cut = beginning.size() > kCostlyPartsBytes;
  if (beginning.size() < kGlbHeaderBytes && (format == MeshFormat::kAuto || format == MeshFormat::kGlb)) return kAll;
  if (format == MeshFormat::kAuto) {
    const std::optional<MeshFormat> shown = SniffMeshFormat(beginning);
    if (!shown) return beginning.size() > kSniffedBytes ? kAll : CostlyParts{};  // otherwise loading it fails at once
    format = *shown;
  }
  if (cut) beginning = beginning.first(kCostlyPartsBytes);
  if (format == MeshFormat::kDraco) return {.compressed = true};
  if (format == MeshFormat::k3mf) return kAll;
  std::string_view text(reinterpret_cast<const char*>(beginning.data()), beginning.size());
  if (format == MeshFormat::kObj) return {.images = cut || Contains(text, "mtllib")};
  if (format == MeshFormat::kStl || format == MeshFormat::kPly || format == MeshFormat::kOff) return {};
  if (format == MeshFormat::kGlb) {
    uint32_t text_bytes = 0;
    std::memcpy(&text_bytes, text.data() + kTextBytesAt, sizeof text_bytes);
    text.remove_prefix(kGlbHeaderBytes);
    if (text_bytes > text.size()) return kAll;
    text = text.substr(0, text_bytes);
  } else {
    const size_t last = text.find_last_not_of(" \t\r\n");
    if (cut || last == std::string_view::npos || text[last] != '}') return kAll;
  }
  if (Contains(text, "\\u")) return kAll;
  return {Contains(text, "_compression"), Contains(text, "_instancing"), Contains(text, "\"images\"")};
}

}  // namespace voxelpipe
