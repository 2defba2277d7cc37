#include "meshes/mesh_store.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "wire/status.h"

namespace voxelpipe {

absl::StatusOr<std::shared_ptr<KeptMesh>> MeshStore::Insert(std::shared_ptr<KeptMesh> mesh, const std::string& client) {
  const uint64_t bytes = mesh->memory_bytes();
  const std::string name = mesh->name();
  auto [kept, room] = meshes_.Insert(name, std::move(mesh), bytes, client);
  if (kept) return kept;
  if (room < max_bytes()) {
    return MakeLimitError(
        absl::StrCat("the mesh takes ", bytes, " bytes of memory; of the ", max_bytes(),
                     " bytes of all meshes that are kept, others have their shares and ", room, " bytes are left"),
        {bytes, room, 0});
  }
  return MakeLimitError(
      absl::StrCat("the mesh takes ", bytes, " bytes of memory, the limit of all meshes that are kept is ", max_bytes(),
                   " bytes"),
      {bytes, max_bytes(), 0});
}

absl::StatusOr<std::shared_ptr<KeptMesh>> MeshStore::Take(const std::string& name) {
  std::shared_ptr<KeptMesh> mesh = meshes_.Use(name);
  if (!mesh) return MissingMeshError(name);
  mesh->CountUse();
  return mesh;
}

absl::StatusOr<std::shared_ptr<const TriangleMesh>> MeshStore::Mesh(const JobContext& job, KeptMesh& mesh,
                                                                    const TextureUse& use, const LoadLimits& limits,
                                                                    LoadWorkers* workers) {
  if (mesh.ready(use)) return mesh.Mesh(job, use, limits);
  absl::StatusOr<std::shared_ptr<const TriangleMesh>> textured = mesh.Mesh(job, use, limits, workers);
  if (textured.ok()) meshes_.Resize(mesh.name(), &mesh, mesh.memory_bytes());
  return textured;
}

std::shared_ptr<TriangleMesh> MeshStore::Moved(KeptMesh& mesh, const std::shared_ptr<const TriangleMesh>& of) {
  if (mesh.keeps_moved()) return mesh.Moved(of, true);
  const bool keep_one = mesh.memory_bytes() <= max_bytes() / 16;
  std::shared_ptr<TriangleMesh> moved = mesh.Moved(of, keep_one);
  if (keep_one) meshes_.Resize(mesh.name(), &mesh, mesh.memory_bytes());
  return moved;
}

absl::StatusOr<std::shared_ptr<KeptMesh>> MeshStore::Get(const std::string& name) const {
  std::shared_ptr<KeptMesh> mesh = meshes_.Peek(name);
  if (!mesh) return MissingMeshError(name);
  return mesh;
}

absl::StatusOr<std::shared_ptr<KeptMesh>> MeshStore::Release(const std::string& name, const std::string& client) {
  std::shared_ptr<KeptMesh> gone;
  switch (meshes_.Release(name, client, gone)) {
    case ClaimedLru<KeptMesh>::Released::kNoClaim:
      if (!meshes_.Peek(name)) return MissingMeshError(name);
      return absl::PermissionDeniedError("the mesh was uploaded by others");
    case ClaimedLru<KeptMesh>::Released::kStays: return nullptr;
    case ClaimedLru<KeptMesh>::Released::kGone: break;
  }
  return gone;
}

absl::StatusOr<std::shared_ptr<KeptMesh>> MeshStore::Delete(const std::string& name) {
  std::shared_ptr<KeptMesh> mesh = meshes_.Erase(name);
  if (!mesh) return MissingMeshError(name);
  return mesh;
}

}  // namespace voxelpipe
