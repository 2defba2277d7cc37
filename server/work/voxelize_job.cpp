#include "work/voxelize_job.h"

#include <new>
#include <utility>

#include "meshes/prepare_kept.h"
#include "shaders/catalog.h"

namespace voxelpipe {

uint64_t VoxelizeJob::file_bytes() const {
  uint64_t bytes = 0;
  for (const std::string& piece : pieces) bytes += piece.size();
  return bytes;
}

bool VoxelizeJob::loaded() const {
  if (mesh) return true;
  if (file_bytes() > kLoadedByWorker) return false;
  // Decoding textures of a mesh that is kept takes as long as loading it did.
  return !kept || !RequestReadsTextures(config.request) || kept->ready(TexturesRead(config.request));
}

absl::Status VoxelizeJob::Prepare() {
  if (mesh) return context.Check();
  absl::StatusOr<std::shared_ptr<const PreparedMesh>> prepared = absl::ResourceExhaustedError("out of memory");
  try {
    std::vector<uint8_t> file;
    file.reserve(file_bytes());
    for (; !pieces.empty(); pieces.pop_front()) file.insert(file.end(), pieces.front().begin(), pieces.front().end());
    prepared = kept ? PrepareKept(*store, *kept, file, config, *limits, context)
                    : PrepareMesh(std::move(file), config, *limits, context);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory for the mesh file");
  }
  if (!prepared.ok()) return prepared.status();
  mesh = *std::move(prepared);
  traits.cost.triangles = mesh->mesh->triangles.size();
  return absl::OkStatus();
}

bool VoxelizeJob::Load() {
  if (absl::Status s = Prepare(); !s.ok()) {
    Done(std::move(s));
    return false;
  }
  return true;
}

}  // namespace voxelpipe
