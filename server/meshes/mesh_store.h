// The stored meshes, by the SHA-256 of their files' bytes.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "absl/status/statusor.h"
#include "mesh/scene/load_limits.h"
#include "meshes/claimed_lru.h"
#include "meshes/kept_mesh.h"
#include "wire/placed_stored.h"

namespace voxelpipe {

// An LRU store with a limit in bytes and a fair share for each client (ClaimedLru). A client has a claim on each mesh
// that it uploaded, which no other client can remove; any client can use a mesh by its id. Jobs hold references, so
// that deletion and eviction do not affect them. Thread-safe; only Mesh waits for the work of other callers (decoding
// textures).
class MeshStore {
 public:
  // A mesh unused for this long counts for no client's share.
  static constexpr std::chrono::minutes kShareHolds{10};

  explicit MeshStore(uint64_t max_bytes) : meshes_(max_bytes, kShareHolds) {}

  // Stores a mesh that `client` uploaded, as most recently used. Out: the stored mesh, which may be an earlier equal
  // one. RESOURCE_EXHAUSTED with need and limit (LimitErrorOf) if it is larger than the store, or than the others'
  // shares leave.
  absl::StatusOr<std::shared_ptr<KeptMesh>> Insert(std::shared_ptr<KeptMesh> mesh, const std::string& client);

  // The mesh, adding a claim of `client`, which also uploaded it; it becomes the most recently used; null if there is
  // none.
  std::shared_ptr<KeptMesh> Claim(const std::string& name, const std::string& client) {
    return meshes_.Claim(name, client);
  }

  // The mesh for a job; it becomes the most recently used. NOT_FOUND (MissingMeshError).
  absl::StatusOr<std::shared_ptr<KeptMesh>> Take(const std::string& name);

  // The meshes of a list for one job, in its order; each counts one use however often it is named. NOT_FOUND naming all
  // that are missing (MissingMeshesError). May throw bad_alloc.
  absl::StatusOr<std::vector<std::shared_ptr<KeptMesh>>> TakeAll(std::span<const PlacedStored> list);
  // The same without counting a use.
  absl::StatusOr<std::vector<std::shared_ptr<KeptMesh>>> GetAll(std::span<const PlacedStored> list) const;

  // KeptMesh::Mesh for a mesh of this store; counts the memory of its textures.
  absl::StatusOr<std::shared_ptr<const TriangleMesh>> Mesh(const JobContext& job, KeptMesh& mesh, const TextureUse& use,
                                                           const LoadLimits& limits, LoadWorkers* workers = nullptr);

  // KeptMesh::Moved for a mesh of this store; counts the memory of the copy. A copy is kept if both take at most an
  // eighth of the store.
  std::shared_ptr<TriangleMesh> Moved(KeptMesh& mesh, const std::shared_ptr<const TriangleMesh>& of);

  // Marks the mesh as most recently used, without a job; null if there is none.
  std::shared_ptr<KeptMesh> Touch(const std::string& name) { return meshes_.Touch(name); }

  // The mesh, without counting a use. NOT_FOUND (MissingMeshError).
  absl::StatusOr<std::shared_ptr<KeptMesh>> Get(const std::string& name) const;

  // Releases the client's claim on the mesh, and removes the mesh if no other client has one. Out: the mesh, so that
  // the caller chooses the thread that frees it; null if it stays for others. NOT_FOUND (MissingMeshError);
  // PERMISSION_DENIED without a claim.
  absl::StatusOr<std::shared_ptr<KeptMesh>> Release(const std::string& name, const std::string& client);

  // Removes the mesh whatever claims it has, and returns it. NOT_FOUND (MissingMeshError).
  absl::StatusOr<std::shared_ptr<KeptMesh>> Delete(const std::string& name);

  // The meshes on which `client` has a claim, of null all of them; at most `count`, the newest first. `before`: the
  // number of the last one of the page before, with which the list goes on; absent: the beginning.
  using Listed = ClaimedLru<KeptMesh>::Listed;
  std::vector<Listed> List(const std::string* client, std::optional<uint64_t> before, size_t count) const {
    return meshes_.List(client, before, count);
  }

  LruStats stats() const { return meshes_.stats(); }
  uint64_t max_bytes() const { return meshes_.limit_bytes(); }
  // Evicts meshes that do not fit any more.
  void set_max_bytes(uint64_t bytes) { meshes_.set_limit_bytes(bytes); }

 private:
  ClaimedLru<KeptMesh> meshes_;
};

}  // namespace voxelpipe
