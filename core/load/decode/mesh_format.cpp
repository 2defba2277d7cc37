#include "load/decode/mesh_format.h"

#include <cstring>
#include <string_view>

namespace voxelpipe {
namespace {

bool StartsWith(std::span<const uint8_t> bytes, std::string_view magic) {
  return bytes.size() >= magic.size() && std::memcmp(bytes.data(), magic.data(), magic.size()) == 0;
}

bool LooksLikeJson(std::span<const uint8_t> bytes) {
  if (StartsWith(bytes, "\xEF\xBB\xBF")) return true;  // a byte order mark
  for (const uint8_t byte : bytes) {
    if (byte == ' ' || byte == '\t' || byte == '\n' || byte == '\r') continue;
    return byte == '{';
  }
  return false;
}

}  // namespace

std::optional<MeshFormat> SniffMeshFormat(std::span<const uint8_t> bytes) {
  if (StartsWith(bytes, "glTF")) return MeshFormat::kGlb;
  if (StartsWith(bytes, "DRACO")) return MeshFormat::kDraco;
  if (LooksLikeJson(bytes)) return MeshFormat::kGltf;
  return std::nullopt;
}

}  // namespace voxelpipe
