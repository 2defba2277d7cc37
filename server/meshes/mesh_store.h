// The meshes that the server keeps, by the SHA-256 of their files' bytes.
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "absl/status/statusor.h"
#include "mesh/scene/load_limits.h"
#include "meshes/claimed_lru.h"
#include "meshes/kept_mesh.h"

namespace voxelpipe {

// Keeps what was used last, up to so many bytes of memory, of each client what fits into its share (ClaimedLru). A
// client has a claim on what it uploaded, and no other client takes that away; to use a mesh its id is enough. Jobs
// hold what they use, deleted or put out or not. Thread-safe; only Mesh makes a caller wait for other callers' work
// (textures being decoded).
class MeshStore {
 public:
  // A mesh unused for so long counts for no client's share.
  static constexpr std::chrono::minutes kShareHolds{10};

  explicit MeshStore(uint64_t max_bytes) : meshes_(max_bytes, kShareHolds) {}

  // Keeps a mesh that `client` uploaded, as the one that was used last. Out: the one that is kept, which may be an
  // equal one that came before. RESOURCE_EXHAUSTED with need and limit (LimitErrorOf) where it is larger than all that
  // the store may hold, or than what others' shares leave.
  absl::StatusOr<std::shared_ptr<KeptMesh>> Insert(std::shared_ptr<KeptMesh> mesh, const std::string& client);

  // The mesh that `client` uploaded as well, from now on the one that was used last: null where there is none.
  std::shared_ptr<KeptMesh> Claim(const std::string& id, const std::string& client) {
    return meshes_.Claim(id, client);
  }

  // The mesh for one more job, from now on the one that was used last: NOT_FOUND (MissingMeshError).
  absl::StatusOr<std::shared_ptr<KeptMesh>> Take(const std::string& id);

  // KeptMesh::Mesh of a mesh from here, with what its textures take counted.
  absl::StatusOr<std::shared_ptr<const TriangleMesh>> Mesh(const JobContext& job, KeptMesh& mesh, const TextureUse& use,
                                                           const LoadLimits& limits, LoadWorkers* workers = nullptr);

  // KeptMesh::Moved of a mesh from here, with what the copy takes counted. One is kept where both take an eighth of the
  // store at most.
  std::shared_ptr<TriangleMesh> Moved(KeptMesh& mesh, const std::shared_ptr<const TriangleMesh>& of);

  // Makes the mesh the one that was used last, without a job: null where there is none.
  std::shared_ptr<KeptMesh> Touch(const std::string& id) { return meshes_.Touch(id); }

  // Looks without using: NOT_FOUND (MissingMeshError).
  absl::StatusOr<std::shared_ptr<KeptMesh>> Get(const std::string& id) const;

  // Takes the client's claim on the mesh back, and removes the mesh if no other client has one. Out: the mesh, so that
  // the caller chooses the thread that frees it; null where it stays, for the others. NOT_FOUND (MissingMeshError);
  // PERMISSION_DENIED without a claim.
  absl::StatusOr<std::shared_ptr<KeptMesh>> Release(const std::string& id, const std::string& client);

  // Removes the mesh whatever claims it has, and returns it. NOT_FOUND (MissingMeshError).
  absl::StatusOr<std::shared_ptr<KeptMesh>> Delete(const std::string& id);

  LruStats stats() const { return meshes_.stats(); }
  uint64_t max_bytes() const { return meshes_.limit_bytes(); }
  // Puts out meshes that do not fit any more.
  void set_max_bytes(uint64_t bytes) { meshes_.set_limit_bytes(bytes); }

 private:
  ClaimedLru<KeptMesh> meshes_;
};

// Checks that the text can name a mesh: 64 hexadecimal digits, lower case. INVALID_ARGUMENT naming the field otherwise.
absl::Status CheckMeshId(std::string_view id, std::string_view field);

}  // namespace voxelpipe
