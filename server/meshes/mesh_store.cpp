#include "meshes/mesh_store.h"

#include <algorithm>
#include <string>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "base/limit_error.h"
#include "wire/status.h"

namespace voxelpipe {
namespace {

// `find` is called once for each name, and gives null for what is missing.
template <typename Find>
absl::StatusOr<std::vector<std::shared_ptr<KeptMesh>>> FindAll(std::span<const PlacedStored> list, Find find) {
  std::unordered_map<std::string_view, std::shared_ptr<KeptMesh>> known;
  std::vector<std::shared_ptr<KeptMesh>> meshes;
  std::vector<std::string> missing;
  meshes.reserve(list.size());
  for (const PlacedStored& placed : list) {
    const auto [mesh, fresh] = known.try_emplace(placed.mesh);
    if (fresh && !(mesh->second = find(placed.mesh))) missing.push_back(placed.mesh);
    meshes.push_back(mesh->second);
  }
  if (!missing.empty()) return MissingMeshesError(missing);
  return meshes;
}

}  // namespace

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

absl::StatusOr<std::vector<std::shared_ptr<KeptMesh>>> MeshStore::TakeAll(std::span<const PlacedStored> list) {
  auto meshes = FindAll(list, [this](const std::string& name) { return meshes_.Use(name); });
  if (!meshes.ok()) return meshes;
  std::unordered_set<const KeptMesh*> counted;
  for (const std::shared_ptr<KeptMesh>& mesh : *meshes) {
    if (counted.insert(mesh.get()).second) mesh->CountUse();
  }
  return meshes;
}

absl::StatusOr<std::vector<std::shared_ptr<KeptMesh>>> MeshStore::GetAll(std::span<const PlacedStored> list) const {
  return FindAll(list, [this](const std::string& name) { return meshes_.Peek(name); });
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
