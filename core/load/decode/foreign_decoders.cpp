#include "load/decode/foreign_decoders.h"

#include <atomic>
#include <string_view>

#include "load/decode/glb_container.h"

namespace voxelpipe {
namespace {

bool Has(std::string_view text, std::string_view part) {
  return text.find(part) != std::string_view::npos;
}

std::atomic<bool> forbidden{false};

// JSON has no other spelling of these names, except letters as \uXXXX.
bool TextMayNeed(std::string_view json, const TextureUse& textures) {
  return Has(json, "draco_mesh_compression") || Has(json, "meshopt_compression") || Has(json, "\\u") ||
         (textures.any() && Has(json, "\"images\""));
}

}  // namespace

bool MayNeedForeignDecoder(std::span<const uint8_t> file, MeshFormat format, const TextureUse& textures) {
  if (format == MeshFormat::kAuto) format = SniffMeshFormat(file).value_or(format);
  switch (format) {
    case MeshFormat::kDraco: return true;
    case MeshFormat::kGlb: {
      const absl::StatusOr<GlbChunks> chunks = SplitGlb(file);
      return chunks.ok() && TextMayNeed(chunks->json, textures);  // other files are refused
    }
    case MeshFormat::kGltf: return TextMayNeed({reinterpret_cast<const char*>(file.data()), file.size()}, textures);
    // Images of its material libraries.
    case MeshFormat::kObj:
      return textures.any() && Has({reinterpret_cast<const char*>(file.data()), file.size()}, "mtllib");
    case MeshFormat::k3mf: return true;
    case MeshFormat::kStl:
    case MeshFormat::kPly:
    case MeshFormat::kOff: return false;
    case MeshFormat::kAuto: return false;  // refused
  }
  return true;
}

void ForbidForeignDecoders() {
  forbidden = true;
}

absl::Status CheckForeignDecoders() {
  if (!forbidden) return absl::OkStatus();
  return absl::InternalError("third-party decoders are forbidden in this process");
}

}  // namespace voxelpipe
