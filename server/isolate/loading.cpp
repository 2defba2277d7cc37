#include "isolate/loading.h"

#include <algorithm>
#include <utility>

#include "isolate/load_workers.h"
#include "load/decode/foreign_decoders.h"
#include "load/decode/image.h"

namespace voxelpipe {

absl::StatusOr<LoadedMesh> LoadMesh(std::vector<uint8_t> file, const LoadRequest& request, LoadWorkers* workers,
                                    const JobContext& job) {
  if (workers != nullptr && MayNeedForeignDecoder(file, request.format, request.textures)) {
    return workers->Load(std::move(file), request, job);
  }
  return LoadMeshHere(file, request, job, [&file] { file = {}; });
}

absl::Status DecodeTextures(TriangleMesh& mesh, const LoadLimits& limits, const TextureUse& use, LoadWorkers* workers,
                            const JobContext& job) {
  const bool images = std::any_of(mesh.images.begin(), mesh.images.end(), [](const auto& image) {
    return image != nullptr && image->rgba.empty() && !image->encoded.empty();
  });
  if (workers != nullptr && images && use.any()) return workers->DecodeTextures(mesh, limits, use, job);
  return PrepareTexturesFor(job, mesh, limits, use);
}

}  // namespace voxelpipe
