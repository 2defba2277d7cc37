#include "isolate/loading.h"

#include <algorithm>
#include <utility>

#include "isolate/load_workers.h"
#include "load/decode/foreign_decoders.h"
#include "load/decode/image.h"
#include "wire/status.h"

namespace voxelpipe {

absl::StatusOr<LoadedMesh> LoadMesh(std::vector<uint8_t> file, const LoadRequest& request, LoadWorkers* workers,
                                    const JobContext& job) {
  const bool foreign = workers != nullptr && MayNeedForeignDecoder(job, file, request.type.format, request.textures);
  absl::StatusOr<LoadedMesh> loaded =
      foreign ? workers->Load(std::move(file), request, job) : LoadMeshFor(job, file, request, [&file] { file = {}; });
  if (!loaded.ok()) return OfMesh(loaded.status());
  return loaded;
}

absl::Status DecodeTextures(TriangleMesh& mesh, const LoadLimits& limits, const TextureUse& use, LoadWorkers* workers,
                            const JobContext& job) {
  const bool images = std::any_of(mesh.images.begin(), mesh.images.end(), [](const auto& image) {
    return image != nullptr && image->rgba.empty() && !image->encoded.empty();
  });
  if (workers != nullptr && images && use.any()) return OfMesh(workers->DecodeTextures(mesh, limits, use, job));
  return OfMesh(PrepareTexturesFor(job, mesh, limits, use));
}

}  // namespace voxelpipe
