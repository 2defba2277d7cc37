#include "meshes/mesh_store.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "wire/status.h"

namespace voxelpipe {

absl::StatusOr<std::shared_ptr<KeptMesh>> MeshStore::Insert(std::shared_ptr<KeptMesh> mesh, const std::string& client) {
  const uint64_t bytes = mesh->memory_bytes();
  const std::string id = mesh->id();
  auto [kept, room] = meshes_.Insert(id, std::move(mesh), bytes, client);
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

absl::StatusOr<std::shared_ptr<KeptMesh>> MeshStore::Take(const std::string& id) {
  std::shared_ptr<KeptMesh> mesh = meshes_.Use(id);
  if (!mesh) return MissingMeshError(id);
  mesh->CountUse();
  return mesh;
}

absl::StatusOr<std::shared_ptr<const TriangleMesh>> MeshStore::Mesh(const JobContext& job, KeptMesh& mesh,
                                                                    const TextureUse& use, const LoadLimits& limits,
                                                                    LoadWorkers* workers) {
  if (mesh.ready(use)) return mesh.Mesh(job, use, limits);
  absl::StatusOr<std::shared_ptr<const TriangleMesh>> textured = mesh.Mesh(job, use, limits, workers);
  if (textured.ok()) meshes_.Resize(mesh.id(), &mesh, mesh.memory_bytes());
  return textured;
}

std::shared_ptr<TriangleMesh> MeshStore::Moved(KeptMesh& mesh, const std::shared_ptr<const TriangleMesh>& of) {
  if (mesh.keeps_moved()) return mesh.Moved(of, true);
  const bool keep_one = mesh.memory_bytes() <= max_bytes() / 16;
  std::shared_ptr<TriangleMesh> moved = mesh.Moved(of, keep_one);
  if (keep_one) meshes_.Resize(mesh.id(), &mesh, mesh.memory_bytes());
  return moved;
}

absl::StatusOr<std::shared_ptr<KeptMesh>> MeshStore::Get(const std::string& id) const {
  std::shared_ptr<KeptMesh> mesh = meshes_.Peek(id);
  if (!mesh) return MissingMeshError(id);
  return mesh;
}

absl::StatusOr<std::shared_ptr<KeptMesh>> MeshStore::Release(const std::string& id, const std::string& client) {
  std::shared_ptr<KeptMesh> gone;
  switch (meshes_.Release(id, client, gone)) {
    case ClaimedLru<KeptMesh>::Released::kNoClaim:
      if (!meshes_.Peek(id)) return MissingMeshError(id);
      return absl::PermissionDeniedError("the mesh was uploaded by others");
    case ClaimedLru<KeptMesh>::Released::kStays: return nullptr;
    case ClaimedLru<KeptMesh>::Released::kGone: break;
  }
  return gone;
}

absl::StatusOr<std::shared_ptr<KeptMesh>> MeshStore::Delete(const std::string& id) {
  std::shared_ptr<KeptMesh> mesh = meshes_.Erase(id);
  if (!mesh) return MissingMeshError(id);
  return mesh;
}

absl::Status CheckMeshId(std::string_view id, std::string_view field) {
  const bool digits =
      std::all_of(id.begin(), id.end(), [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f'); });
  if (id.size() == 64 && digits) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(std::string(field), ": must be 64 hexadecimal digits, lower case"));
}

}  // namespace voxelpipe
