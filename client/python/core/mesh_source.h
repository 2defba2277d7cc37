// The meshes that requests of this process use: files, or meshes that stay loaded.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <shared_mutex>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "absl/status/statusor.h"
#include "base/job_context.h"
#include "load/load_mesh.h"
#include "mesh/health/health.h"
#include "mesh/report.h"
#include "mesh/triangle_mesh.h"
#include "voxelpipe/v1/voxelization_service.pb.h"
#include "wire/request.h"

namespace voxelpipe {

// A mesh that stays loaded, for many requests at the same time. Thread-safe.
class HeldMesh {
 public:
  // In: the bytes of a mesh file, which are not needed later, and its name (MeshNameOf). Errors: those of
  // LoadMeshFor, as INVALID_ARGUMENT of a mesh.
  static absl::StatusOr<std::shared_ptr<HeldMesh>> Load(std::span<const uint8_t> file, MeshFileType type,
                                                        std::string name, const JobContext& job);

  const std::string& name() const { return name_; }

  // As a server describes it.
  v1::Mesh Describe() const;

  // Errors: those of CheckHealth.
  absl::StatusOr<MeshHealth> Health(const JobContext& job) const;

 private:
  friend class UsedMesh;
  HeldMesh() = default;
  // Decodes those textures that are not decoded yet. The caller has the lock of no held mesh.
  absl::Status Prepare(const TextureUse& textures, const JobContext& job);
  absl::Status Decode(const TextureUse& textures, const JobContext& job);
  // The report that a request with a fill gets; its edges are counted once. The caller holds mutex_.
  absl::StatusOr<MeshReport> Examined(const JobContext& job);

  std::string name_;
  MeshFileType type_;
  uint64_t file_bytes_ = 0;
  MeshReport report_;
  WarningList warnings_;
  std::mutex examining_;
  std::optional<MeshReport> examined_;  // guarded by examining_
  std::mutex decoding_;                 // of one thread at a time, so that those that wait for it look again
  // Runs share the mesh; who decodes more of its textures has it alone.
  mutable std::shared_mutex mutex_;
  TriangleMesh mesh_;
  TextureUse decoded_;
};

// Where a request has its mesh from: the bytes of a file, or a held mesh, perhaps with new positions: x, y, z as float
// of each vertex, bytes; or several held meshes that are placed on one grid.
struct MeshSource {
  std::span<const uint8_t> file;
  MeshFileType type;               // of the file
  std::shared_ptr<HeldMesh> held;  // null: the file
  std::optional<std::span<const uint8_t>> positions;
  // Where the request places several meshes: each of them, once; not null.
  std::vector<std::shared_ptr<HeldMesh>> several;
};

// The mesh of one request, with the textures that its shaders read. Held meshes stay as they are meanwhile.
class UsedMesh {
 public:
  // Errors: those of LoadMeshFor and PrepareTexturesFor, as of a mesh; INVALID_ARGUMENT for positions that do not fit;
  // of several meshes MissingMeshError if one is not among the source's, and those of PlaceMeshes; those of
  // ExcludeParts.
  static absl::StatusOr<std::unique_ptr<UsedMesh>> Open(const MeshSource& source, const ParsedConfig& config,
                                                        const JobContext& job);

  const TriangleMesh& mesh() const { return *mesh_; }
  const MeshReport& report() const { return report_; }
  bool examined() const { return examined_; }  // degenerate triangles and open edges were counted
  const std::vector<std::pair<std::string, double>>& stages() const { return stages_; }
  uint64_t peak_bytes() const { return peak_bytes_; }

 private:
  UsedMesh() = default;
  absl::Status Hold(const MeshSource& source, const TextureUse& textures, const JobContext& job);
  absl::Status Move(std::span<const uint8_t> positions);
  absl::Status Place(const MeshSource& source, std::span<const PlacedStored> placed, const VoxelizeRequest& request,
                     const JobContext& job);
  // Replaces the mesh by one without the parts that are excluded, if any.
  absl::Status LeaveOut(const PartSelection& parts, const JobContext& job);
  absl::StatusOr<MeshReport> Report(const JobContext& job) const;

  std::vector<std::shared_ptr<HeldMesh>> held_;
  std::vector<std::shared_lock<std::shared_mutex>> locks_;  // of the held meshes
  std::optional<LoadedMesh> loaded_;
  std::optional<TriangleMesh> made_;    // of the others: with new positions, placed, or without excluded parts
  const TriangleMesh* mesh_ = nullptr;  // one of those
  MeshReport report_;
  bool examined_ = false;
  std::vector<std::pair<std::string, double>> stages_;
  uint64_t peak_bytes_ = 0;
};

}  // namespace voxelpipe
