#include "work/voxelize_job.h"

#include <new>
#include <utility>

namespace voxelpipe {

uint64_t VoxelizeJob::file_bytes() const {
  uint64_t bytes = 0;
  for (const std::string& piece : pieces) bytes += piece.size();
  return bytes;
}

absl::Status VoxelizeJob::Prepare() {
  if (mesh) return context.Check();
  absl::StatusOr<std::shared_ptr<const PreparedMesh>> prepared = absl::ResourceExhaustedError("out of memory");
  try {
    std::vector<uint8_t> file;
    file.reserve(file_bytes());
    for (; !pieces.empty(); pieces.pop_front()) file.insert(file.end(), pieces.front().begin(), pieces.front().end());
    prepared = PrepareMesh(std::move(file), config, *limits, context);
  } catch (const std::bad_alloc&) {
    return absl::ResourceExhaustedError("out of memory for the mesh file");
  }
  if (!prepared.ok()) return prepared.status();
  mesh = *std::move(prepared);
  traits.cost.triangles = mesh->mesh.triangles.size();
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
