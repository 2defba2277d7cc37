#include "load/decode/foreign_decoders.h"

#include <atomic>
#include <string_view>

#include "load/base/text_reader.h"
#include "load/decode/glb_container.h"

namespace voxelpipe {
namespace {

std::atomic<bool> forbidden{false};

std::string_view TextOf(std::span<const uint8_t> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

// JSON has no other spelling of these names, except letters as \uXXXX.
bool TextMayNeed(const JobContext& job, std::string_view json, const TextureUse& textures) {
  const auto has = [&](std::string_view part) { return Contains(json, part, job); };
  return has("draco_mesh_compression") || has("meshopt_compression") || has("\\u") ||
         (textures.any() && has("\"images\""));
}

}  // namespace

bool MayNeedForeignDecoder(const JobContext& job, std::span<const uint8_t> file, MeshFormat format,
                           const TextureUse& textures) {
  if (format == MeshFormat::kAuto) format = DetectMeshFormat(job, file).value_or(format);
  switch (format) {
    case MeshFormat::kDraco: return true;
    case MeshFormat::kGlb: {
      const absl::StatusOr<GlbChunks> chunks = SplitGlb(job, file);
      return chunks.ok() && TextMayNeed(job, chunks->json, textures);  // other files are refused
    }
    case MeshFormat::kGltf: return TextMayNeed(job, TextOf(file), textures);
    // Images of its material libraries.
    case MeshFormat::kObj: return textures.any() && Contains(TextOf(file), "mtllib", job);
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
